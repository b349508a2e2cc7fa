"""The benchmark: fixed tasks, one score for each policy, and a page that compares a new one."""
