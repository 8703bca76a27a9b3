"""What stands on the ground of a simulated site and is no height field: crowns and hedges of leaves, fences, wires.

Knows neither the ground nor cameras: sites come from simulation.covered_site, rays from simulation.rendering.
`leaves.Cover`, `hits.first_cover`.
"""
