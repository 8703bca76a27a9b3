"""The stage `results`: everything a surveyor takes away, written beside the project file.

Reads what the other stages have stored, draws and copies it; measures nothing but where the orthophoto shows targets.
`results.publish`.
"""
