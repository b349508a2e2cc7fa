"""The report of a study: its page, its sentences, its tables."""
