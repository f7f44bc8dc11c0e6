"""`auv-gym draw`: a vehicle and its parts, to scale."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from auv_gym.cli.application import app
from auv_gym.cli.options.console import output


@app.command()
def draw(
    vehicle: Annotated[str, typer.Argument(metavar="VEHICLE", help="A preset or a vehicle file (TOML).")],
    out: Annotated[Path, typer.Option(help="The picture to write: .png, .svg or .pdf.")] = Path("vehicle.png"),
) -> None:
    """Draw a six-degree-of-freedom vehicle to scale, from above and from the side, with its parts."""
    from auv_gym.plant import load_vehicle
    from auv_gym.writing import replacing

    kinds = (".png", ".svg", ".pdf")
    if out.suffix.lower() not in kinds:
        raise ValueError(f"--out needs a name that ends in {', '.join(kinds)}, got {out.name!r}.")
    plant = load_vehicle(vehicle)
    from auv_gym.rendering.vehicle import draw_vehicle  # with matplotlib, so not before it is wanted

    figure = draw_vehicle(plant)
    with replacing(out) as new:
        figure.savefig(new, format=out.suffix[1:].lower(), dpi=120)
    output.print(str(out), markup=False)
