"""What there is to see of a run, tick by tick: from messages, without files or sockets."""
