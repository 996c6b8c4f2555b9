"""Gaussian beliefs (Sec. II and IV): prior, filter recursion, gain schedule, expected costs."""
