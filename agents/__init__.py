"""Who decides: policies, scripted, planned or learned.

`slam_gym.policies.make("pursuit", context)` builds one by name; the names are declared as entry points of the group
"slam_gym.policies", so that `slam_gym` never imports this package.
"""
