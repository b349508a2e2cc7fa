"""What only the laboratory needs, and an image for nodes alone does not have."""

PACKAGES = ("matplotlib", "rich")
"""For pictures and tables."""
