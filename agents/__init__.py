"""Who decides: policies, scripted, planned or learned."""
