"""The results folder: tables, their files, their audit, and certificates."""
