"""What a lens does to the picture beyond the camera model.

It knows pictures and functions over them; no residuals, no adjustment.
Enter: `fields.free_field`, `field_basis.field_basis`.
"""
