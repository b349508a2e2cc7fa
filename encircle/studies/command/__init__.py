"""``encircle study``: what is missing is run, and the report is made where it has to be."""
