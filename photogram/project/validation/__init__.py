"""Input validation: what can be found wrong in a project before hours of work.

Needs no pixels; returns findings, and leaves showing them to the caller.
`check` collects the findings of the other modules.
"""
