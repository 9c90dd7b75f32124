"""The data of central: connections, messages, tasks, resources, variables, clock. No rules."""
