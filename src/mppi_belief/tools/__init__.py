"""Commands for people who look after results: `mppi-belief results` and `mppi-belief replay`."""
