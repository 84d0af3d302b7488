"""From payloads to columns of numbers: many messages at a time, down to the library's decoder one by one."""
