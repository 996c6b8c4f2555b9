"""The conditions of the paper's statements for one system, along the belief of one trial."""
