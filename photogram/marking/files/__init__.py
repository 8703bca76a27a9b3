"""What is kept of marking: the actions, and the journal that holds them.

Knows nothing of photographs and their poses.
`actions.state_of`, `journal`.
"""
