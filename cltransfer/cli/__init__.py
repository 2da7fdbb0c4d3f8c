"""The command line: one module a family of verbs; nothing heavy is imported before a verb needs it."""
