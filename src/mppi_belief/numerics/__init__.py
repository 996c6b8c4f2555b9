"""Array numerics: linear algebra, normal deviates, quadrature, maps over samples on the last axis."""
