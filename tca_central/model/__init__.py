"""The data of central: connections, messages, tasks, resources, variables and the clock. Structure,
no rules.
"""
