"""What a setting is: one annotated field, of which checks, errors, tables and schemas are made.

It holds no setting itself: those stand where they are used.
Enter: `settings.Settings`, `settings.settings_of`, `json_schema.schema_of`.
"""
