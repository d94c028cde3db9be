"""What was looked for and how, and what its failure or success says: sorties, contacts, the filter."""
