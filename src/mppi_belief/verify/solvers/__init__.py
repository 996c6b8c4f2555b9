"""Numerical solutions of the paper's equations that use nothing of the planner."""
