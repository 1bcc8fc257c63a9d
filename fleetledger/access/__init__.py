"""Who may call, and what: users, keys, sessions, roles, and the audit (docs/access.md)."""
