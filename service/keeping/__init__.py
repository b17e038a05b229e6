"""What keeps a farm's work over the years: films are looked after (patrol), copied (backup) and brought back (restore)."""
