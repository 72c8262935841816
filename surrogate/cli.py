"""The command `macrofit-surrogate`."""

from __future__ import annotations

import click

STILL_TO_COME = "Still to come: the network that learns the friction of rough plates, and its training data."


@click.group(invoke_without_command=True, epilog=STILL_TO_COME)
@click.version_option(package_name="macrofit", prog_name="macrofit-surrogate")
@click.pass_context
def main(context: click.Context) -> None:
    """The network that replaces the rough plates."""
    if context.invoked_subcommand is None:
        click.echo(STILL_TO_COME)
