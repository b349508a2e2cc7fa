"""What of a hunt is drawn and plotted in the field's viewers, before any of their formats."""
