"""Marks of ground points in photographs: the journal of marking, its tables, and the files of other programs.

Keeps and converts what was marked; measures nothing in photographs, and decides nothing about weights or roles.
`journal.Journal`, `actions.state_of`, `mark_table` and `formats`.
"""
