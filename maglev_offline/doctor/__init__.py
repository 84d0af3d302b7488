"""What `maglev-offline doctor` looks at: the installation, the engines, the machine, the recipe and the workspace.

It is for the day on which something is missing. So nothing but the standard library is imported before it is needed,
and what may crash is tried in a process of its own.
"""
