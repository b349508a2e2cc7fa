"""Networks as they were measured: transport reports, traces, certificates."""
