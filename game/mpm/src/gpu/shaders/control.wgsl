// Choice of the next substep by the rules of `simulation.rs`: sound travels at most the Courant number of
// cells, and particles and balls at most half a cell.

// Plans the next substep, or none if no time is left or particles must be sorted first.
fn plan(before: Control) -> Control {
    var c = before;
    c.scatter = 0u;
    if (c.left <= 0.0 || c.group_left == 0u) {
        return c;
    }
    var fastest = c.speed;
    for (var i = 0u; i < params.balls; i++) {
        fastest = max(fastest, length(balls[i].velocity));
    }
    let by_sound = params.courant * params.cell_size / c.sound;
    let by_travel = TRAVEL_CELLS_MAX * params.cell_size / max(fastest, 1e-30);
    let count = max(ceil(c.left / min(by_sound, by_travel)), 1.0);
    let dt = c.left / count;
    let travel = c.speed * dt / params.cell_size;
    if (c.drift + travel > DRIFT_MAX || c.travelled + travel > params.margin) {
        c.group_left = 0u;
        return c;
    }
    c.dt = dt;
    c.drift += travel;
    c.travelled += travel;
    c.group_left -= 1u;
    c.scatter = 1u;
    // A power of two, so that scaling is exact. An i32 holds 16 times the nominal mass at the speed
    // `bound`. Its second term is for stress, which changes velocities by about the speed of sound times
    // the strain.
    let bound = c.speed + 0.125 * c.sound;
    c.momentum_scale = params.mass_scale * exp2(-ceil(log2(bound)));
    return c;
}

// Updates the state after a substep with the speeds found in it, and plans the next.
fn next_substep(before: Control, speed: f32, sound: f32) -> Control {
    var c = before;
    if (c.scatter == 0u) {
        c.gather = 0u;
        return c;
    }
    c.substeps += 1u;
    // The last substep is as long as what is left.
    c.left = select(c.left - c.dt, 0.0, c.dt >= c.left);
    c.speed = speed;
    c.sound = sound;
    c.gather = 1u;
    c.gather_scale = c.momentum_scale;
    return plan(c);
}
