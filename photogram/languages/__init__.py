"""Texts in the languages of those who are handed a survey: catalogs of messages, figures, dates and lists.

English is the source, and stands where it is said: this room knows none of those who say it.
`language.Language`.
"""
