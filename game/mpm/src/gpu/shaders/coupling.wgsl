// Two-way coupling of balls: one workgroup resolves the contacts of each ball with the nodes that touch it, moves the
// balls, and plans the next substep.
//
// Node i that touches a ball gets the impulse `J = m (s − u)` that makes it move as the surface, s, if that pushes and
// Coulomb's cone allows it; else the impulse of the cone. The ball's velocity and spin y solve
// `D (y − y₀) + Σ Gᵀ J(G y) = 0`, G the surface's velocity, D the ball's masses: what the sequential impulses of
// `coupling.rs` converge to. Newton's method, as J is linear in pieces; sums in a fixed order.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> control: Control;
@group(0) @binding(2) var<storage, read_write> counters: Counters;
@group(0) @binding(6) var<storage, read_write> velocities: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> balls: array<Ball>;
@group(0) @binding(11) var<storage, read> obstacles: array<Obstacle>;
@group(0) @binding(18) var<storage, read_write> touches: array<vec4<i32>>;

const LANES: u32 = 128u;

// Components of a residual and of the upper half of its derivative.
const TERMS: u32 = 27u;
const ROUNDS_MAX: u32 = 12u;

// Terms of each lane, a row each.
var<workgroup> rows: array<f32, 3456>;
// Sums of a quarter of the lanes.
var<workgroup> quarters: array<f32, 108>;
var<workgroup> totals: array<f32, 27>;
// Velocity and spin of the ball under way.
var<workgroup> linear: vec3<f32>;
var<workgroup> spin: vec3<f32>;
var<workgroup> is_solved: u32;
var<workgroup> touched: u32;

struct Contact {
    // On the node, in kg·m/s.
    impulse: vec3<f32>,
    // Derivative by the surface's velocity, but for the part of a slipping node's normal direction that turns
    // friction, which would not be symmetric.
    derivative: mat3x3<f32>,
    is_pushed: bool,
}

struct Found {
    node: u32,
    at: vec3<f32>,
    // From the ball's centre, over its radius.
    arm: vec3<f32>,
    // Velocity and mass.
    velocity: vec4<f32>,
    // Away from the ball.
    normal: vec3<f32>,
    // Speed at which they part if they overlap, in m/s.
    parting: f32,
    is_touching: bool,
}

fn outer(a: vec3<f32>, b: vec3<f32>) -> mat3x3<f32> {
    return mat3x3(a * b.x, a * b.y, a * b.z);
}

// The matrix of a cross product from the left.
fn cross_matrix(a: vec3<f32>) -> mat3x3<f32> {
    return mat3x3(vec3(0.0, a.z, -a.y), vec3(-a.z, 0.0, a.x), vec3(a.y, -a.x, 0.0));
}

// Of a found node at a velocity of the ball.
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
    let along = slip / slip_speed;
    let drag = friction * push;
    let across = identity - outer(normal, normal) - outer(along, along);
    let derivative = outer(normal, normal) * mass + across * (drag / slip_speed);
    return Contact(normal * push - along * drag, derivative, true);
}

// Whether a node is nearer to another touched ball's surface.
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

// From a ball's surface to the farthest node of a particle that touches it, in cells: its extent and a cell of nearing,
// and the reach of its kernel.
const TOUCH_REACH_CELLS: f32 = 3.0;

// The nodes in the box around a ball: first corner, and how many along each axis.
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

// Residual and derivative at the present velocity and spin, summed over a lane's nodes, as its row.
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
        let turn = cross_matrix(found.arm);
        let by_spin = contact.derivative * turn;
        vv += contact.derivative;
        vw -= by_spin;
        ww -= turn * by_spin;
    }
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

// The solution of a positive definite system by Gauss, six rows of six and the right side.
fn solve(system: ptr<function, array<array<f32, 7>, 6>>) -> array<f32, 6> {
    for (var k = 0u; k < 6u; k++) {
        for (var i = k + 1u; i < 6u; i++) {
            // No pivots are looked for, as none is 0 or below.
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

// One step of Newton's method from `totals`; from the sixth on half of one, against cycles.
fn newton(ball: u32, v0: vec3<f32>, w0: vec3<f32>, round: u32) {
    let mass = balls[ball].mass;
    var system = array<array<f32, 7>, 6>();
    for (var i = 0u; i < 3u; i++) {
        system[i][i] = totals[6u + i] + mass;
        // Arms are over the radius and spins times it: of the moment of inertia 2/5 of the mass are left.
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

// Gives the nodes of a lane their impulses, and leaves the sums on the ball as its row.
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
        // A ball must not push particles through an obstacle.
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

// Makes the sums of touch around a ball ready for the next substep.
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
