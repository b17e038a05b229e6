"""Access control: users, passwords, sessions, tokens, projects, quotas, and the audit log."""
