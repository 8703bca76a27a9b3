"""Where photographs show ground points that are still to be marked, and what the marks there are say of each other.

Works before anything is matched, from tags and marks alone; reads no files and shows nothing.
`predictions.predicted_places` says where to look, `mark_comparison.compared_marks` which marks contradict the rest.
"""
