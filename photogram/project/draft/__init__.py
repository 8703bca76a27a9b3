"""The project that `photogram init` writes: cameras, positions and sites from the tags of the photographs.

Guesses no standard deviation in silence: every value that it assumes is written out with its reason.
`draft.draft_project`, and `text` for the file itself.
"""
