"""The page of `photogram mark`: a server of this machine alone that shows patches of photographs and keeps their marks.

Computes no predictions of its own, decodes nothing at its start, and answers nobody but this machine.
`session.MarkingSession` keeps and tests the marks, `server.MarkServer` serves them with `patches.PatchReader`.
"""
