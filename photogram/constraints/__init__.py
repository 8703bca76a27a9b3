"""What surveyors measure between points: distances, height differences, level surfaces, planes; cameras on one body.

It holds data and names them; what they mean for an adjustment is in photogram.factors.constraints.
Enter: `between_points.Distance`, `known_surface.SurfaceControl`, `between_points.observations`, `rigs.RelativePose`.
"""
