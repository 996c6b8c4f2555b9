"""The parts of `make bench-scale`, each a module whose `measure` gives numbers as JSON and `markdown` shows them."""
