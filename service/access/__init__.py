"""Who may do what: users, their passwords, sessions and tokens, and a record of what was done."""
