"""The command `macrofit-meso`."""

from __future__ import annotations

import click

STILL_TO_COME = "Still to come: rough surfaces, the plates built from them and their coefficient of friction."


@click.group(invoke_without_command=True, epilog=STILL_TO_COME)
@click.version_option(package_name="macrofit", prog_name="macrofit-meso")
@click.pass_context
def main(context: click.Context) -> None:
    """Rough plates and their friction."""
    if context.invoked_subcommand is None:
        click.echo(STILL_TO_COME)
