"""The matching condition (Sec. III and V-B): Theorem 1, control weights and
sensors for which it holds.
"""
