"""A scene as text: the equations, guards and events that its compiled tables really simulate."""

from collections.abc import Iterable, Iterator

import numpy as np

from vibro_ros.model.forms import MASS, PLATE, SLIDER, Form, Forms, Guard
from vibro_ros.model.ground import GROUND_STATES
from vibro_ros.model.modes import MODE_EVENTS, OUTPUTS, Mode, ModeBuilder
from vibro_ros.model.motor import Motor
from vibro_ros.model.scene import Scene
from vibro_ros.model.slider import Slider
from vibro_ros.model.tables import Model, compile_scene
from vibro_ros.solver.system import NOTHING, form_value

#: Symbols of a dc motor's coordinates, each with its line in the section of states.
MOTOR = {"θ": "θ, θ'    angle [rad] and speed [rad/s] of the crank",
         "Q": "Q, Q' = i    charge [C] that has passed the motor, and its current [A]"}
_ROUNDING = 1e-12  # a coefficient is rounding error if it is smaller than this fraction of the terms that cancel in it


def describe(scene: Scene) -> str:
    """Return states, forcing, equations, modes, guards and events of `scene` in the paper's symbols with values.

    The equations are read from the compiled tables, and the guards from the forms that were compiled, so that the text
    shows what is integrated. Effects that are off do not appear in the text.
    """
    description = _Description(scene)
    sections = {
        "states": list(description.states()), "known in time": list(description.forcing()),
        "equations": list(description.equations()), "modes": list(description.modes()),
        "guards: a state lasts while its conditions hold": list(description.guards()),
        "events": list(description.events()), "effects": list(description.effects()),
    }
    blocks = ("\n".join([title, *_columns(lines)]) for title, lines in sections.items() if lines)
    return "\n\n".join([f"scene {scene.name}", *blocks]) + "\n"


class _Description:
    """The sections of one scene's description, each as lines."""

    def __init__(self, scene: Scene):
        self._scene = scene
        self._model: Model = compile_scene(scene)
        self._builder = ModeBuilder(scene)
        self._symbols = Symbols(self._model.forms)
        self._ground = self._builder.ground
        self._has_dry_friction = self._ground.has_dry_friction
        # Without dry friction the states only say whether the body is on the ground.
        self._friction_name = "friction" if self._has_dry_friction else "ground"

    def states(self) -> Iterator[str]:
        meaning = {"u": "upper mass on its guide", "w": "inclined mass on its guide",
                   "x": f"body {'along' if self._model.forms.body_hops else 'on'} the ground",
                   "y": "body above the ground"}
        for symbol in self._symbols.coordinates:
            if symbol in MOTOR:
                yield MOTOR[symbol]
                continue
            yield f"{symbol}, {symbol}'    position [m] and speed [m/s] of the {meaning[symbol]}"
        if not self._model.forms.body_moves:
            yield "x = 0    no force acts on the body along the ground"

    def forcing(self) -> Iterator[str]:
        scene, forms = self._scene, self._model.forms
        follows = {"ideal": "at once", "ramp": f"at {scene['motor.acceleration']:g} rad/s²",
                   "lag": f"with a time constant of {scene['motor.time_constant']:g} s"}
        if forms.has_rotor:
            yield self._held()
        else:
            yield f"θ' = {scene['motor.speed']:g} rad/s    follows a command {follows[scene['effects.motor']]}"
        for symbol, slider in zip(self._symbols.signals, self._model.sliders, strict=True):
            yield f"{symbol} = {_slider_text(slider)}"
        for side in forms.plates:
            position = scene[f"crank.{side}_rod"] + scene[f"{side}.gap"]
            yield f"{PLATE[side]} = {position:g} m    follows a command at {scene['gap_actuator.speed']:g} m/s"

    def _held(self) -> str:
        """Return the line for h, the voltage or current at which the dc motor is held between samples."""
        scene, control = self._scene, self._scene["motor.control"]
        unit = "A" if control == "speed_by_current" else "V"
        if control == "voltage":
            return f"h = {scene['motor.voltage']:g} V    the voltage that is commanded"
        return f"h = 0 {unit}    set {scene['motor.control_rate']:g} times a second by the controller of the speed"

    def _equations_of_the_motor(self, motor: Motor) -> Iterator[str]:
        """Yield lines for the torque of the drives, the crank and the current."""
        rows, forms = self._model.system.equations, self._model.forms
        for signal, loads in zip(self._symbols.signals, self._model.system.rotor.load.swapaxes(0, 1), strict=True):
            yield from self._cases(f"T_{signal} = ", self._texts(loads))
        yield "T = " + (" + ".join(f"T_{signal} d{signal}/dθ" for signal in self._symbols.signals) or "0")
        yield from self._cases(f"{motor.inertia:g} θ'' = ", self._texts(motor.inertia * rows[:, forms.phase]))
        if motor.inductance:
            yield from self._cases(f"{motor.inductance:g} i' = ", self._texts(motor.inductance * rows[:, forms.charge]))
        else:
            yield from self._cases("i = ", self._texts(self._model.system.rotor.current))

    def equations(self) -> Iterator[str]:
        """Yield lines for the masses, by the states of their contacts, and for the body, with forces [N]."""
        forms = self._model.forms
        for i, side in enumerate(forms.guides):
            rows = self._scene[f"mass.{side}"] * self._model.system.equations[:, i]
            yield from self._cases(f"{self._scene[f'mass.{side}']:g} {MASS[side]}'' = ", self._texts(rows))
        for contact in self._builder.contacts:
            if "resting" in contact.states:
                rows = self._output(f"{contact.side}_plate_force")
                yield from self._cases(f"force on {PLATE[contact.side]} = ", self._texts(rows))
        if self._builder.motor:
            yield from self._equations_of_the_motor(self._builder.motor)
        if forms.body_moves:
            yield from self._equations_along_the_ground()
        if forms.body_hops:
            upwards = self._scene.total_mass * self._model.system.equations[:, forms.height]
            yield from self._with_remark(f"{self._scene.total_mass:g} y'' = ", self._texts(upwards, "airborne"),
                                         "while airborne, else 0")
        if self._has_dry_friction or forms.body_hops:
            yield from self._normal_force()
        if self._has_dry_friction:
            yield from self._friction_force()

    def _texts(self, rows: np.ndarray, friction: str | None = None) -> dict[tuple[str, ...], str]:
        """Return the text of each mode's form, by the mode's states; `rows` has the shape (modes, channels).

        If `friction` is given, only modes with this state of the ground are returned.
        """
        return {mode.states: self._symbols.text(row) for mode, row in zip(self._model.modes, rows, strict=True)
                if friction in (None, mode.ground)}

    def _cases(self, head: str, texts: dict[tuple[str, ...], str]) -> Iterator[str]:
        """Yield a line for each different text, with the states of those effects on which the text depends."""
        names = self._effect_names()
        for text in dict.fromkeys(texts.values()):
            holding = {states for states, of_mode in texts.items() if of_mode == text}
            matter = [effect for effect in range(len(names)) if not _holds_for_all(holding, effect, texts)]
            cases = dict.fromkeys(" and ".join(f"{names[effect]} {states[effect]}" for effect in matter)
                                  for states in texts if states in holding)
            condition = f"    while {' or '.join(cases)}" if any(cases) else ""
            yield f"{head}{text}{condition}"

    def _with_remark(self, head: str, texts: dict[tuple[str, ...], str], remark: str) -> Iterator[str]:
        """Yield the lines of `_cases` with a remark before the states."""
        for line in self._cases(head, texts):
            equation, _, cases = line.partition("    while ")
            yield f"{equation}    {remark}{f'; where {cases}' if cases else ''}"

    def _effect_names(self) -> list[str]:
        motor = ["bearing", "current loop"][:len(self._builder.motor.effects)] if self._builder.motor else []
        return [f"{contact.side} contact" for contact in self._builder.contacts] + motor + [self._friction_name]

    def _equations_along_the_ground(self) -> Iterator[str]:
        """Yield lines for x'', F_in and each force of the ground except dry friction."""
        total, body = self._scene.total_mass, self._model.forms.body
        inertial = total * self._model.system.equations[:, body]
        inertial = inertial + sum(self._ground.forces.values())
        if self._has_dry_friction:
            inertial = inertial + self._builder.friction_force()[self._builder.mode_set.stance]
        first = self._ground.states[0]
        yield f"{total:g} x'' = {self._ground.driving_symbol}{' - F_fr' if self._has_dry_friction else ''}"
        yield from self._with_remark("F_in = ", self._texts(inertial, first), "eq. (7)")
        for force, form in self._ground.forces.items():
            yield f"{force.symbol} = {self._symbols.text(form)}"

    def _output(self, name: str) -> np.ndarray:
        """Forms of an output, shape (modes, channels); the state of the ground changes fastest from mode to mode."""
        return self._model.output[:, OUTPUTS.index(name)]

    def _normal_force(self) -> Iterator[str]:
        normal, states = self._output("normal_force"), self._ground.states
        source = "eq. (6)" if normal[0, :self._model.forms.channels.one].any() else "weight"
        reported = "; reported as 0 where it is negative" * ("unloaded" in states)
        airborne = "; 0 while airborne" * ("airborne" in states)
        yield from self._with_remark("N = ", self._texts(normal, states[0]), f"{source}{reported}{airborne}")

    def _friction_force(self) -> Iterator[str]:
        """Yield lines for F_fr, one for each state of the ground."""
        normal, friction = self._output("normal_force")[0], self._output("friction_force")
        decayed = self._model.forms.decayed_normal_force()
        law = f"N exp(-|x'|/{self._scene['ground.stribeck_speed']:g})"
        for m, state in enumerate(self._ground.states):
            falling = float(form_value(decayed, friction[m]))
            form, size = friction[m] - falling * decayed, float(form_value(normal, normal))
            balances = GROUND_STATES[state].friction is None  # F_fr balances the other forces
            factor = None if balances else float(form_value(form, normal)) / size if size else 0.0
            sliding = [(part, symbol) for part, symbol in ((factor, "N"), (falling, law)) if part]
            yield f"F_fr = {self._ground.driving_symbol if factor is None else _sum(sliding)}    while {state}"

    def modes(self) -> Iterator[str]:
        """Yield a line with the number of modes, as a product of the numbers of states, and the first mode."""
        effects = self._guarded_effects()
        counts = " × ".join(f"{len(states)} ({name})" for name, states in effects.items())
        states = dict(zip(self._effect_names(), self._model.modes[self._model.initial_mode].states, strict=True))
        initial = ", ".join(states[name] for name in effects)
        if self._builder.motor and "bearing" in effects and self._scene["motor.speed"]:
            initial = "that of a crank that turns"
        if self._scene["start.state"] == "given":
            initial = "that of the given start"
        yield f"{len(self._model.modes)}{' = ' if effects else ''}{counts}{'; first ' if effects else ''}{initial}"

    def _guarded_effects(self) -> dict[str, tuple[str, ...]]:
        """Return the states of each effect that has more than one, by the effect's name."""
        motor = self._builder.motor.effects if self._builder.motor else ()
        states = [effect.states for effect in (*self._builder.contacts, *motor, self._ground)]
        return {name: of_effect for name, of_effect in zip(self._effect_names(), states, strict=True)
                if len(of_effect) > 1}

    def guards(self) -> Iterator[str]:
        """Yield a line for each condition of each state, with the states to try when the condition fails."""
        guards = {mode: list(self._builder.guards(mode)) for mode in self._model.modes}
        for name, states in self._guarded_effects().items():
            effect = self._effect_names().index(name)
            for state in states:
                by_mode = {mode: [guard for guard, of_effect, _ in of_mode if of_effect == effect]
                           for mode, of_mode in guards.items() if mode.states[effect] == state}
                for same in zip(*by_mode.values(), strict=True):  # the same guard in all modes with this state
                    [text] = {guard.text for guard in same}
                    if "{voltage}" in text and self._builder.motor:
                        text = text.format(voltage=self._symbols.text(self._builder.motor.wanted_voltage()))
                    if "{force}" in text:
                        plate = self._model.forms.plates[effect]
                        text = text.format(force=self._symbols.text(self._model.forms.plate_force(plate)))
                    ends = {mode.states: self._end(mode, effect, guard)
                            for mode, guard in zip(by_mode, same, strict=True)}
                    yield from self._cases(f"{name} {state}: {text}    else ", ends)

    def _end(self, mode: Mode, effect: int, guard: Guard) -> str:
        """Return the states to which a guard leads, those that a shock also changes, and the speeds that jump."""
        others = [f"{name} open" for other, (name, state) in enumerate(zip(
            self._effect_names(), mode.states, strict=True)) if other != effect and state == "resting"]
        targets = dict[str, None]()
        for target in guard.targets:
            words = [target.state] if target.ground is None else [target.state, target.ground]
            words += [f"bearing {target.bearing}"] if target.bearing else []
            targets[" and ".join(words + others * target.frees_resting_masses)] = None
        return f"{' or '.join(targets)}{self._jumps(guard)}"

    def _jumps(self, guard: Guard) -> str:
        """Return the speeds that stop or jump when a guard fires, as text."""
        coordinates, speeds = self._symbols.coordinates, dict[str, bool]()
        jumps = [(channel, bool(form.any())) for target in guard.targets for channel, form in target.jumps]
        jumps += [(channel, True) for target in guard.targets if target.shock for channel in target.shock.speeds]
        for channel, stays in sorted(jumps, key=lambda jump: jump[0]):
            if channel >= len(coordinates):
                speed = f"{coordinates[channel - len(coordinates)]}'"
                speeds[speed] = speeds.get(speed, False) or stays
        stopped = "".join(f", with {speed} = 0" for speed, jumps in speeds.items() if not jumps)
        jumping = [speed for speed, jumps in speeds.items() if jumps]
        where = f", where {' and '.join(jumping)} jump{'s' if len(jumping) == 1 else ''}"
        return stopped + where * bool(jumping)

    def events(self) -> Iterator[str]:
        kinds = sorted(set(self._model.system.events.kind.ravel()) - {NOTHING})
        words = [f"{side}_contact" for side in self._model.forms.plates] + [MODE_EVENTS[kind] for kind in kinds]
        if self._scene["effects.motor"] in ("ramp", "lag"):
            words.append("motor_ramp_end")
        if self._model.forms.plates:
            words.append("gap_reached")
        yield ", ".join(words) or "none"

    def effects(self) -> Iterator[str]:
        """Yield a line with the effects of the scene that the tables contain."""
        scene, forms = self._scene, self._model.forms
        words = [f"{side} mass" for side in forms.guides]
        for contact in self._builder.contacts:
            rigid = f"rigid, restitution {scene[f'{contact.side}.plate.restitution']:g}"
            kind = rigid if "resting" in contact.states else "compliant"
            words.append(f"{contact.side} contact, {kind}" + ", without tension" * ("released" in contact.states))
        if self._has_dry_friction:
            words.append(f"{scene['effects.friction']} friction, normal force {scene['effects.normal_force']}")
        words += ["the body leaves the ground"] * forms.body_hops
        words += [f"mass of the {part.replace('_', ' ')}" for part in scene.linkage]
        words += ["reaction on the masses"] * (scene["effects.reaction"] and (forms.body_moves or forms.body_hops))
        words += ["the paper's misprint taken literally"] * forms.has_misprint
        words += ["weight of the masses"] * any(forms.weight(side).any() for side in forms.guides)
        words.append(f"{scene['effects.motor']} motor")
        if len(self._model.system.accounts.account):
            words.append("energy accounts")
        yield "; ".join(words)


def _holds_for_all(holding: set[tuple[str, ...]], effect: int, every: Iterable[tuple[str, ...]]) -> bool:
    """Whether membership in `holding`, a subset of `every`, does not depend on the state of `effect`."""
    choices = {states[effect] for states in every}
    return all(states[:effect] + (choice,) + states[effect + 1:] in holding for states in holding for choice in choices)


def _slider_text(slider: Slider) -> str:
    angle = f"(θ {'-' if slider.angle > 0.0 else '+'} {abs(slider.angle):g})" if slider.angle else "θ"
    if slider.rod == 0.0:
        return f"{slider.radius:g} cos {angle}"
    if slider.radius == slider.rod:
        return f"{slider.radius:g} (cos {angle} + |cos {angle}|)"
    return f"{slider.radius:g} cos {angle} + √({slider.rod:g}² - {slider.radius:g}² sin² {angle})"


def _columns(lines: list[str]) -> Iterator[str]:
    """Yield the lines, indented, with the text after a gap of four spaces aligned in a column."""
    width = max(len(line.partition("    ")[0]) for line in lines)
    for line in lines:
        head, _, remark = line.partition("    ")
        yield f"  {head:<{width}}    {remark}".rstrip()


class Symbols:
    """Writer of one scene's forms as text."""

    def __init__(self, forms: Forms):
        self._channels = forms.channels
        driven = ["x"] * (forms.body_moves and not forms.body_is_dynamic) + ["y"] * forms.body_hops
        self.coordinates = [*(MASS[side] for side in forms.guides), *["x"] * forms.body_is_dynamic,
                            *list(MOTOR) * forms.has_rotor, *driven]
        self._guides, self._plates = forms.guides, forms.plates
        self.signals = [SLIDER[side] for side in forms.guides]
        self.signals += ["p_x", "p_y"][:forms.channels.signals - len(self.signals)]  # of the crank pin

    def text(self, form: Form) -> str:
        """Return the form as text, such as ``-1000 (u - s_B) - 1e+07 (u - E)``; ``0`` when it is empty."""
        return _sum(self._terms(form))

    def _terms(self, form: Form) -> Iterator[tuple[float, str]]:
        """Yield coefficients and symbols: differences to sliders and plates, then other channels, the constant last."""
        left = dict(enumerate(map(float, form)))
        largest = {channel: abs(factor) for channel, factor in left.items()}
        for channel, other, text in self._differences():
            factor = left.pop(other)
            if factor:
                left[channel] += factor
                largest[channel] = max(largest[channel], abs(factor))
                yield -factor, text
        at = self._channels
        names = {at.one: ""}  # symbols of channels that are written by themselves
        if at.rotors:
            names |= {at.torque: "T", at.held: "h"}
        for i, symbol in enumerate(self.coordinates):
            names |= {at.position(i): symbol, at.velocity(i): "i" if symbol == "Q" else f"{symbol}'"}
            if i < at.dynamic:
                names[at.acceleration(i)] = f"{symbol}''"
        for k, symbol in enumerate(self.signals[:at.signal_accelerations]):
            names[at.signal_acceleration(k)] = f"{symbol}''"
        for channel, factor in left.items():
            if abs(factor) > _ROUNDING * largest[channel]:
                yield factor, names[channel]

    def _differences(self) -> Iterator[tuple[int, int, str]]:
        """Yield the channels of a mass and of its slider or plate, and their difference as text; also for the rates."""
        at = self._channels
        for i, side in enumerate(self._guides):
            mass, slider = MASS[side], SLIDER[side]
            yield at.position(i), at.signal(i), f"({mass} - {slider})"
            yield at.velocity(i), at.signal_rate(i), f"({mass}' - {slider}')"
        for k, side in enumerate(self._plates):
            i, mass, plate = self._guides.index(side), MASS[side], PLATE[side]
            yield at.position(i), at.ramp(k), f"({mass} - {plate})"
            yield at.velocity(i), at.ramp_rate(k), f"({mass}' - {plate}')"


def _sum(terms: Iterable[tuple[float, str]]) -> str:
    """Return a sum of factors times symbols as text; ``0`` when it is empty."""
    text = ""
    for factor, symbol in terms:
        sign = "-" if factor < 0.0 else "+"
        number = "" if abs(factor) == 1.0 and symbol else f"{abs(factor):.6g}"
        term = f"{number} {symbol}".strip()
        text += f" {sign} {term}" if text else f"{sign.replace('+', '')}{term}"
    return text or "0"
