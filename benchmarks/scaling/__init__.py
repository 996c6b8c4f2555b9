"""Parts of `make bench-scale`: `measure` returns numbers as JSON, `markdown` their table."""
