"""Array numerics: linear algebra, normal deviates, quadrature, maps over samples.

Samples are on the last axis of arrays throughout.
"""
