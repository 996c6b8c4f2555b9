"""Planning by sampled trajectories (Sec. V and VI): path integrals, samplers, trajectory optimisation."""
