"""What was looked for, how, and what its failure or success says: sorties, contacts, the filter, the decision to suspend."""
