"""A finished survey handed over to CAD and GIS: drawings, projects and terrain that other programs open.

Computes nothing of the survey anew and changes none of its products.
`hand_over.deliver`, `survey_contents`, and one module for each product.
"""
