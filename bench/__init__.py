"""The benchmark: frames -> jobs -> runs, each checked -> figures -> record (table, JSON, plot)."""
