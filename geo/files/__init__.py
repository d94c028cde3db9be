"""Files and addresses: opened, read in processes of their own where bytes may crash a library, and fingerprinted."""
