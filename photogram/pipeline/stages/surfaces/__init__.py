"""The stages `surface` and `relief`: the DSM, the same closed within a rim, terrain and contour lines.

Know no report, and no orthophoto; what others read of them comes back through `stored_surface` and `closing`.
`surface.SURFACE`, `relief.RELIEF`, `closing.stored_closing`.
"""
