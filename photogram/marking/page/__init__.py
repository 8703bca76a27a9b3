"""The page of `photogram mark`, for the browser of this machine alone: patches of photographs, and their marks.

Computes no predictions of its own and decodes nothing at its start. `photogram desk` shows it within its own page.
`session.MarkingSession` keeps and tests the marks, `addresses.MarkingPage` answers with `patches.PatchReader`.
"""
