"""Many objects from one cause: worlds, fates, finds, and what comes ashore where and when."""
