"""What an authority asks of a survey: figures of report.json mapped to its classes or statements.

Enter at `profiles.standard_record`. A class is stated from check points alone, and where there are enough of them.
"""
