"""One adapter per library. Each runs in that library's environment: no imports from `mppi_belief` but in `ours`."""
