"""The costs of messages and tasks here, beside other programs that move messages."""
