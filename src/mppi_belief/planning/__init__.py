"""Planning (Sec. V and VI): path integrals and their parts, trajectory optimisation."""
