"""How a robot decides: the policies that ship, and the check of what any policy answers."""
