"""Adapters, one module per library; each has `make(name, workload, dtype)`."""
