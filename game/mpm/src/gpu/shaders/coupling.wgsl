// Two-way coupling of balls: one workgroup resolves the contacts of each ball with the nodes whose
// particles touch it, moves the balls, and plans the next substep.
//
// A node of mass m and velocity u in contact gets the impulse `J = m (s − u)` that gives it the velocity s
// of the ball's surface, if J pushes and lies within Coulomb's cone; otherwise the impulse on the cone. The
// ball's velocity and spin y solve `D (y − y₀) + Σ Gᵀ J(G y) = 0`, with G y the surface's velocity at a
// node and D the ball's mass matrix. This is the fixed point of the sequential impulses of `coupling.rs`.
// Newton's method solves it in few rounds, as J is nearly piecewise linear; sums are in a fixed order, so
// that the bits are reproducible.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> control: Control;
@group(0) @binding(2) var<storage, read_write> counters: Counters;
@group(0) @binding(6) var<storage, read_write> velocities: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> balls: array<Ball>;
@group(0) @binding(11) var<storage, read> obstacles: array<Obstacle>;
@group(0) @binding(18) var<storage, read_write> touches: array<vec4<i32>>;

const LANES: u32 = 128u;

// Sums of a Newton step: 6 of the residual and 21 of the upper triangle of its symmetric 6x6 derivative.
const TERMS: u32 = 27u;
const ROUNDS_MAX: u32 = 12u;

// Partial sums: LANES rows of TERMS numbers.
var<workgroup> rows: array<f32, 3456>;
// Sums over each quarter of the lanes.
var<workgroup> quarters: array<f32, 108>;
var<workgroup> totals: array<f32, 27>;
// Velocity and spin (angular velocity times radius) of the ball being solved, in m/s.
var<workgroup> linear: vec3<f32>;
var<workgroup> spin: vec3<f32>;
var<workgroup> is_solved: u32;
var<workgroup> touched: u32;

struct Contact {
    // Impulse on the node, in kg·m/s.
    impulse: vec3<f32>,
    // Derivative of the impulse by the surface's velocity, without the dependence of friction on the normal
    // impulse of slipping nodes, which would make it unsymmetric.
    derivative: mat3x3<f32>,
    is_pushed: bool,
}

struct Found {
    node: u32,
    at: vec3<f32>,
    // From the ball's centre to the node, over the radius.
    arm: vec3<f32>,
    // Velocity in m/s and mass in kg.
    velocity: vec4<f32>,
    // Unit normal, away from the ball.
    normal: vec3<f32>,
    // Normal speed at which an overlap is separated, in m/s.
    parting: f32,
    is_touching: bool,
}

fn outer(a: vec3<f32>, b: vec3<f32>) -> mat3x3<f32> {
    return mat3x3(a * b.x, a * b.y, a * b.z);
}

// Skew-symmetric matrix of the cross product with `a` from the left.
fn cross_matrix(a: vec3<f32>) -> mat3x3<f32> {
    return mat3x3(vec3(0.0, a.z, -a.y), vec3(-a.z, 0.0, a.x), vec3(a.y, -a.x, 0.0));
}

// Contact of a node with a ball of velocity `v` and spin `w`.
fn contact(found: Found, friction: f32, v: vec3<f32>, w: vec3<f32>) -> Contact {
    let normal = found.normal;
    let relative = found.velocity.xyz - v - cross(w, found.arm);
    let nearing = dot(relative, normal);
    let approach = nearing - found.parting;
    if (approach >= 0.0) {
        return Contact(vec3(0.0), mat3x3<f32>(), false);
    }
    let identity = mat3x3(vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0), vec3(0.0, 0.0, 1.0));
    let mass = found.velocity.w;
    let push = -mass * approach;
    let slip = relative - normal * nearing;
    let slip_speed = length(slip);
    if (mass * slip_speed <= friction * push) {
        return Contact(-mass * (relative - normal * found.parting), identity * mass, true);
    }
    // On the cone, the derivative along the slip is 0, and across it friction turns with the slip:
    // μ·push/|slip|.
    let along = slip / slip_speed;
    let drag = friction * push;
    let across = identity - outer(normal, normal) - outer(along, along);
    let derivative = outer(normal, normal) * mass + across * (drag / slip_speed);
    return Contact(normal * push - along * drag, derivative, true);
}

// Whether a node is nearer to the surface of another touched ball; equal distances go to the lower index.
fn is_others(ball: u32, at: vec3<f32>, depth: f32) -> bool {
    for (var other = 0u; other < params.balls; other++) {
        if (other == ball || (touched >> other & 1u) == 0u) {
            continue;
        }
        let distance = length(at - balls[other].position - balls[other].moved) - balls[other].radius;
        if (distance < depth || (distance == depth && other < ball)) {
            return true;
        }
    }
    return false;
}

// Largest distance from a ball's surface of a node of a particle that touches it, in cells: the particle's
// extent, its approach of at most a cell, and the reach of its kernel.
const TOUCH_REACH_CELLS: f32 = 3.0;

// The first node of the box of nodes around a ball, and below the number of nodes along each axis.
fn corner(ball: u32) -> vec3<i32> {
    let reach = balls[ball].radius + TOUCH_REACH_CELLS;
    let low = vec3<i32>(ceil(balls[ball].position + balls[ball].moved - reach));
    return clamp(low, vec3(0), vec3<i32>(params.blocks * 4u));
}

fn extent(ball: u32, first: vec3<i32>) -> vec3<u32> {
    let reach = balls[ball].radius + TOUCH_REACH_CELLS;
    let high = vec3<i32>(floor(balls[ball].position + balls[ball].moved + reach)) + 1;
    return vec3<u32>(max(clamp(high, vec3(0), vec3<i32>(params.blocks * 4u)) - first, vec3(0)));
}

fn node_at(place: vec3<u32>) -> u32 {
    let in_block = place & vec3(3u);
    return block_index(place / 4u, params.blocks) * 64u + (in_block.x * 4u + in_block.y) * 4u + in_block.z;
}

fn place_at(first: vec3<i32>, size: vec3<u32>, index: u32) -> vec3<u32> {
    return vec3<u32>(first) + vec3(index / (size.y * size.z), index / size.z % size.y, index % size.z);
}

fn find(ball: u32, first: vec3<i32>, size: vec3<u32>, index: u32) -> Found {
    let place = place_at(first, size, index);
    let at = vec3<f32>(place);
    let arm = at - (balls[ball].position + balls[ball].moved);
    let node = node_at(place);
    var found = Found(node, at, arm / balls[ball].radius, vec4(0.0), vec3(0.0), 0.0, false);
    let sums = vec4<f32>(touches[node]);
    let touching = length(sums.xyz);
    if (touching == 0.0) {
        return found;
    }
    found.velocity = velocities[node];
    found.normal = sums.xyz / touching;
    found.parting = min(PARTING * (sums.w / touching) * params.cell_size / control.dt, PARTING_MAX);
    let is_enough = touching > SHARE_MIN * found.velocity.w * params.mass_scale;
    found.is_touching = is_enough && !is_others(ball, at, length(arm) - balls[ball].radius);
    return found;
}

// Sums the lanes' rows into `totals`.
fn sum_rows(lane: u32) {
    workgroupBarrier();
    if (lane < 4u * TERMS) {
        let quarter = lane / TERMS;
        let term = lane % TERMS;
        var sum = 0.0;
        for (var i = 0u; i < 32u; i++) {
            sum += rows[(quarter * 32u + i) * TERMS + term];
        }
        quarters[lane] = sum;
    }
    workgroupBarrier();
    if (lane < TERMS) {
        totals[lane] = quarters[lane] + quarters[lane + TERMS] + quarters[lane + 2u * TERMS] + quarters[lane + 3u * TERMS];
    }
    workgroupBarrier();
}

// Sums the contact terms of the residual and derivative at the present velocity and spin over a lane's
// nodes into its row.
fn linearise(ball: u32, lane: u32) {
    let first = corner(ball);
    let size = extent(ball, first);
    let count = size.x * size.y * size.z;
    var force = vec3(0.0);
    var torque = vec3(0.0);
    var vv = mat3x3<f32>();
    var vw = mat3x3<f32>();
    var ww = mat3x3<f32>();
    for (var index = lane; index < count; index += LANES) {
        let found = find(ball, first, size, index);
        if (!found.is_touching) {
            continue;
        }
        let contact = contact(found, friction_of(found.node), linear, spin);
        if (!contact.is_pushed) {
            continue;
        }
        force += contact.impulse;
        torque += cross(found.arm, contact.impulse);
        // The surface moves at s = v + w × a = v − [a]× w, so that dJ/dw = −D [a]×; the torque is [a]× J.
        let turn = cross_matrix(found.arm);
        let by_spin = contact.derivative * turn;
        vv += contact.derivative;
        vw -= by_spin;
        ww -= turn * by_spin;
    }
    // A row holds force, torque, the diagonal of vv, its off-diagonal entries, vw by columns, and ww as vv.
    let row = lane * TERMS;
    for (var i = 0u; i < 3u; i++) {
        rows[row + i] = force[i];
        rows[row + 3u + i] = torque[i];
        rows[row + 6u + i] = vv[i][i];
        rows[row + 12u + 3u * i] = vw[i].x;
        rows[row + 13u + 3u * i] = vw[i].y;
        rows[row + 14u + 3u * i] = vw[i].z;
        rows[row + 21u + i] = ww[i][i];
    }
    rows[row + 9u] = vv[1].x;
    rows[row + 10u] = vv[2].x;
    rows[row + 11u] = vv[2].y;
    rows[row + 24u] = ww[1].x;
    rows[row + 25u] = ww[2].x;
    rows[row + 26u] = ww[2].y;
}

// Solves a positive definite system by Gaussian elimination: six rows of six coefficients and the
// right-hand side.
fn solve(system: ptr<function, array<array<f32, 7>, 6>>) -> array<f32, 6> {
    for (var k = 0u; k < 6u; k++) {
        for (var i = k + 1u; i < 6u; i++) {
            // No pivoting: the pivots of a positive definite matrix are positive.
            let factor = (*system)[i][k] / (*system)[k][k];
            for (var j = k; j < 7u; j++) {
                (*system)[i][j] -= factor * (*system)[k][j];
            }
        }
    }
    var x = array<f32, 6>();
    for (var n = 0u; n < 6u; n++) {
        let i = 5u - n;
        var sum = (*system)[i][6];
        for (var j = i + 1u; j < 6u; j++) {
            sum -= (*system)[i][j] * x[j];
        }
        x[i] = sum / (*system)[i][i];
    }
    return x;
}

// One Newton step from `totals`. From round 6 on it is halved, which breaks cycles between pieces of the
// residual.
fn newton(ball: u32, v0: vec3<f32>, w0: vec3<f32>, round: u32) {
    let mass = balls[ball].mass;
    var system = array<array<f32, 7>, 6>();
    for (var i = 0u; i < 3u; i++) {
        system[i][i] = totals[6u + i] + mass;
        // With arms over the radius and spins times it, the moment of inertia 2/5 m r² becomes 2/5 m.
        system[i + 3u][i + 3u] = totals[21u + i] + 0.4 * mass;
        system[i][6] = mass * (v0[i] - linear[i]) - totals[i];
        system[i + 3u][6] = 0.4 * mass * (w0[i] - spin[i]) - totals[3u + i];
        for (var j = 0u; j < 3u; j++) {
            let entry = totals[12u + 3u * j + i];
            system[i][j + 3u] = entry;
            system[j + 3u][i] = entry;
        }
    }
    for (var part = 0u; part < 2u; part++) {
        let at = 3u * part;
        let from_term = 9u + 15u * part;
        system[at][at + 1u] = totals[from_term];
        system[at + 1u][at] = totals[from_term];
        system[at][at + 2u] = totals[from_term + 1u];
        system[at + 2u][at] = totals[from_term + 1u];
        system[at + 1u][at + 2u] = totals[from_term + 2u];
        system[at + 2u][at + 1u] = totals[from_term + 2u];
    }
    var change = solve(&system);
    let scale = select(1.0, 0.5, round >= 6u);
    let dv = vec3(change[0], change[1], change[2]) * scale;
    let dw = vec3(change[3], change[4], change[5]) * scale;
    linear += dv;
    spin += dw;
    let size = max(length(linear), length(spin));
    is_solved = select(0u, 1u, max(length(dv), length(dw)) <= 1e-6 * size + 1e-9);
}

// Applies the impulses to the nodes of a lane, and stores their sums in its row.
fn apply(ball: u32, lane: u32) {
    let first = corner(ball);
    let size = extent(ball, first);
    let count = size.x * size.y * size.z;
    var force = vec3(0.0);
    var torque = vec3(0.0);
    for (var index = lane; index < count; index += LANES) {
        let found = find(ball, first, size, index);
        if (!found.is_touching) {
            continue;
        }
        let friction = friction_of(found.node);
        let contact = contact(found, friction, linear, spin);
        force += contact.impulse;
        torque += cross(found.arm, contact.impulse);
        let velocity = found.velocity.xyz + contact.impulse / found.velocity.w;
        // Obstacles have the last word: a ball must not push particles through them.
        velocities[found.node] = vec4(stop_all(found.at, velocity, friction), found.velocity.w);
    }
    for (var i = 0u; i < 3u; i++) {
        rows[lane * TERMS + i] = force[i];
        rows[lane * TERMS + 3u + i] = torque[i];
    }
}

fn resolve(ball: u32, lane: u32) {
    let v0 = balls[ball].velocity;
    let w0 = balls[ball].spin;
    if (lane == 0u) {
        linear = v0;
        spin = w0;
    }
    workgroupBarrier();
    for (var round = 0u; round < ROUNDS_MAX; round++) {
        linearise(ball, lane);
        sum_rows(lane);
        if (lane == 0u) {
            newton(ball, v0, w0, round);
        }
        if (workgroupUniformLoad(&is_solved) != 0u) {
            break;
        }
    }
    apply(ball, lane);
    sum_rows(lane);
    if (lane == 0u) {
        let force = vec3(totals[0], totals[1], totals[2]);
        let torque = vec3(totals[3], totals[4], totals[5]);
        let mass = balls[ball].mass;
        balls[ball].velocity = v0 - force / mass;
        balls[ball].spin = w0 - torque / (0.4 * mass);
        balls[ball].impulse -= force;
        balls[ball].turn -= torque;
    }
}

// Clears the touch sums around a ball for the next substep.
fn clear_touches(ball: u32, lane: u32) {
    let first = corner(ball);
    let size = extent(ball, first);
    for (var index = lane; index < size.x * size.y * size.z; index += LANES) {
        touches[node_at(place_at(first, size, index))] = vec4(0);
    }
}

@compute @workgroup_size(128)
fn couple(@builtin(local_invocation_index) lane: u32) {
    if (lane == 0u) {
        touched = select(0u, atomicLoad(&counters.touched), control.scatter != 0u);
    }
    let bits = workgroupUniformLoad(&touched);
    if (lane < params.balls && control.scatter != 0u) {
        balls[lane].velocity += balls[lane].acceleration * control.dt;
    }
    storageBarrier();
    workgroupBarrier();
    for (var ball = 0u; ball < params.balls; ball++) {
        if ((bits >> ball & 1u) != 0u) {
            resolve(ball, lane);
            storageBarrier();
            workgroupBarrier();
        }
    }
    // Only after all balls are resolved, as their boxes may overlap.
    for (var ball = 0u; ball < params.balls; ball++) {
        if ((bits >> ball & 1u) != 0u) {
            clear_touches(ball, lane);
        }
    }
    storageBarrier();
    workgroupBarrier();
    if (lane < params.balls && control.scatter != 0u) {
        balls[lane].moved += balls[lane].velocity * (control.dt / params.cell_size);
        let sunk = balls[lane].floor_height - balls[lane].position.z - balls[lane].moved.z;
        if (sunk > 0.0) {
            balls[lane].moved.z += sunk;
            balls[lane].velocity.z = max(balls[lane].velocity.z, 0.0);
        }
    }
    storageBarrier();
    workgroupBarrier();
    if (lane == 0u) {
        var speed = bitcast<f32>(atomicExchange(&counters.speed, 0u));
        // Nodes in contact may have taken over the velocity of a ball's surface, which this bounds.
        for (var ball = 0u; ball < params.balls; ball++) {
            if ((bits >> ball & 1u) != 0u) {
                speed = max(speed, length(balls[ball].velocity) + length(balls[ball].spin));
            }
        }
        let sound = bitcast<f32>(atomicExchange(&counters.sound, 0u));
        atomicStore(&counters.touched, 0u);
        control = next_substep(control, speed, sound);
    }
}
