"""The thesis's studies: a scenario in; logs, figures and claims out. Only the command line imports them."""
