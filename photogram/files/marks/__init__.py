"""Marks of ground points in photographs: the journal of marking, and its tables.

Keeps what was marked; measures nothing in photographs, and decides nothing about weights or roles.
`journal.Journal`, `actions.state_of` and `mark_table`.
"""
