"""Breaks by another simulator, many times over: how `references/breaks.json` was made.

    pip install pooltool-billiards==0.6.0     (Apache-2.0; on Linux with --no-deps, and panda3d 1.10)
    python break_pooltool.py FOLDER break_eight_seed1 break_nine_seed1 > breaks.json

FOLDER holds references in the schema `phys-ref-1`. Each rack is broken 400 times: the first time as
the file has it, then with each ball moved within a circle of 10 um, as far as there is room, as
`carom-bench physics --part breaks` moves them. What is counted is what that counts.
"""

import json
import math
import sys

import numpy as np
import pooltool as pt
import pooltool.physics.evolve as evolve
from pooltool.objects.ball.datatypes import Ball, BallState

TIMES, MOVED_M, ENERGY_AFTER_SECS = 400, 1e-5, 0.25
POCKETED = 4


def moves(file, seed):
    """Of each racked ball, in the order of the file."""
    random = np.random.default_rng([seed, 77])
    radius = file["ball_params"]["R"]
    places = {ball: np.array(state["pos"][:2]) for ball, state in file["initial"].items()}
    moved = {}
    for ball in [ball for ball in places if ball != "cue" and seed > 0]:
        for _ in range(8):
            by, angle = MOVED_M * math.sqrt(random.random()), 2 * math.pi * random.random()
            place = places[ball] + by * np.array([math.cos(angle), math.sin(angle)])
            others = (other for name, other in places.items() if name != ball)
            if all(np.hypot(*(place - other)) >= 2 * radius for other in others):
                moved[ball], places[ball] = place - places[ball], place
                break
    return moved


def system(file, moved):
    constants = {k: v for k, v in file["ball_params"].items() if k != "u_sp"}
    balls = {}
    for name, state in file["initial"].items():
        rvw = np.array([state["pos"], state["vel"], state["spin"]], float)
        rvw[0, :2] += moved.get(name, 0.0)
        balls[name] = Ball.create(name, xy=state["pos"][:2], **constants)
        balls[name].state = BallState(rvw, 0, 0.0)
    cue = pt.Cue(cue_ball_id="cue")
    cue.set_state(**{name: file["cue"][name] for name in ("V0", "phi", "theta", "a", "b")})
    return pt.System(cue=cue, table=pt.Table.default(), balls=balls)


def energy(state, params):
    turning = 0.4 * params.R**2 * np.dot(state[2], state[2])
    return 0.5 * params.m * (np.dot(state[1], state[1]) + turning)


def energy_at(shot, secs):
    total = 0.0
    for ball in shot.balls.values():
        last = [state for state in ball.history.states if state.t <= secs + 1e-12][-1]
        if last.s != POCKETED:
            p = ball.params
            constants = dict(R=p.R, m=p.m, u_s=p.u_s, u_sp=p.u_sp, u_r=p.u_r, g=p.g)
            rvw, _ = evolve.evolve_ball_motion(
                state=last.s, rvw=last.rvw, t=secs - last.t, **constants
            )
            total += energy(rvw, p)
    return total


def outcome(shot):
    lying = [ball.state.rvw[0] for ball in shot.balls.values() if ball.state.s != POCKETED]
    spread = np.array(lying) - np.mean(lying, axis=0)
    kept = energy_at(shot, ENERGY_AFTER_SECS) / energy_at(shot, 0.0)
    return kept, math.sqrt((spread**2).sum(1).mean()), len(shot.balls) - len(lying)


def main(folder, names):
    racks = {}
    for name in names:
        file = json.load(open(f"{folder}/{name}.json"))
        shots = (pt.simulate(system(file, moves(file, seed))) for seed in range(TIMES))
        kept, spread, pocketed = zip(*map(outcome, shots))
        racks[name] = {
            "energy_kept": [round(float(value), 6) for value in kept],
            "spread_m": [round(value, 5) for value in spread],
            "pocketed": pocketed,
        }
    print(json.dumps({"source": "pooltool-billiards 0.6.0", "racks": racks}))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
