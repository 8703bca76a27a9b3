"""The epochs of a survey as the project file gives them.

Reads no photograph.
`entries.epochs_of`.
"""
