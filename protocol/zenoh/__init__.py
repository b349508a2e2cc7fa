"""Everything of Zenoh: connections, configuration, certificates, who is there."""
