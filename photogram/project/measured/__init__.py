"""What was measured before the tie points: positions, attitudes and ground points, in the frame of the survey.

Reads no photograph; its tags come as data.
`measured_block.block_of`, `measured_positions.measured_position`, `measured_survey`.
"""
