"""The command line; `simpick.cli.main` lists the commands."""
