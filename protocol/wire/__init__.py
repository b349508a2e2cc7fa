"""What a message field is made of: limits, checks of values, types on the wire, declarations."""
