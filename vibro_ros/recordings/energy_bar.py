"""The picture of the energy accounts: two bars of equal length, what the robot received and where it went."""

from typing import Any

from matplotlib.axes import Axes

# Okabe and Ito's palette, which the colour-blind tell apart, by account.
_COLOURS = {"motor": "#009e73", "plates": "#999999", "unpaid": "#cc79a7", "drive dampers": "#0072b2",
            "plate dampers": "#d55e00", "friction": "#e69f00", "blows": "#000000", "landings": "#56b4e9",
            "stored": "#f0e442"}
_GIVES = ("motor", "plates", "unpaid")
_NEGLIGIBLE = 1e-3  # of the whole: too narrow to be seen


def draw_energy(axes: Axes, energy: dict[str, Any]) -> None:
    """Draw the accounts of `recordings.energy.energy_of`; what gives where it usually takes changes the bar."""
    received, spent = parts_of(energy["accounts"])
    for row, parts in enumerate((spent, received)):
        start = 0.0
        for name, amount in parts.items():
            axes.barh(row, amount, left=start, color=_COLOURS[name], edgecolor="white", lw=0.8, height=0.72,
                      label=f"{name} {amount:.4g} J")
            start += amount
    handles, labels = axes.get_legend_handles_labels()
    first = len(spent)  # what was received is told first, as its bar stands above
    axes.legend(handles[first:] + handles[:first], labels[first:] + labels[:first], loc="upper left",
                bbox_to_anchor=(0.0, -0.32), ncols=len(handles), frameon=False, fontsize=8.5, handlelength=1.0,
                handletextpad=0.4, columnspacing=1.2, borderaxespad=0.0)
    axes.set_yticks([0, 1], ["lost and\nstored", "received"])
    axes.set_xlim(0.0, max(sum(received.values()), sum(spent.values())) or 1.0)
    axes.set_xlabel("energy [J]", loc="right", labelpad=-1.0)
    axes.set_title("where the energy went: the recorded run, simulated again; the motor's work is net of what the "
                   f"springs returned, {energy['accounts']['motor_taken_back']:.4g} J", fontsize=8.5, loc="left")


def parts_of(accounts: dict[str, float]) -> tuple[dict[str, float], dict[str, float]]:
    """Amounts [J] that were received, and those that were lost or stored, none negative; negligible ones left out."""
    signed = {name: accounts.get(name.replace(" ", "_"), 0.0) * (1.0 if name in _GIVES else -1.0) for name in _COLOURS}
    signed["motor"] = accounts["motor_delivered"] - accounts["motor_taken_back"]
    least = _NEGLIGIBLE * max(map(abs, signed.values()))
    received = {name: amount for name, amount in signed.items() if amount > least}
    return received, {name: -amount for name, amount in signed.items() if amount < -least}
