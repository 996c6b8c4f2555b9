"""One certificate per module: the statement, the numbers, the bands and the panels."""
