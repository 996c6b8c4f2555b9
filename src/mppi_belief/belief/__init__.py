"""Gaussian beliefs (Sec. II and IV): filter recursion, Riccati equation, gain schedule, expected costs."""
