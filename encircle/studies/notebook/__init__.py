"""A study in a notebook: what is there so far, and how it is shown."""
