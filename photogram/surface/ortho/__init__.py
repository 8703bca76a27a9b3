"""The orthophoto: visibility, colour balance, seamlines, resampling.

Draws a cell only from photographs that see it; invents no colour.
`orthophoto.plan_orthophoto`.
"""
