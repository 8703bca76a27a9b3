"""What the command does that compares two epochs: call the library, show tables and progress.

Computes nothing that a notebook could want.
`compare`, `tables`.
"""
