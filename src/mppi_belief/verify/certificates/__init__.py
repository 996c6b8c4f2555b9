"""Certificates of the paper's statements, one module each."""
