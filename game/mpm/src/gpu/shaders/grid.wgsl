// Grid update: momentum becomes velocity, gravity acts, and obstacles bound velocities. One workgroup
// processes one block of nodes.

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> control: Control;
@group(0) @binding(2) var<storage, read_write> counters: Counters;
@group(0) @binding(5) var<storage, read_write> sums: array<vec4<i32>>;
@group(0) @binding(6) var<storage, read_write> velocities: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read> obstacles: array<Obstacle>;
@group(0) @binding(14) var<storage, read> nodes: array<u32>;

// Mass in quanta from which a node counts for the largest speed: rounding dominates the velocities of
// lighter ones, which do not move a particle by a hundredth of a cell.
const SPEED_MASS_MIN: i32 = 2048;

// Half of the range of i32: sums beyond it are reported before they can wrap.
const SUM_MAX: i32 = 0x3fffffff;

var<workgroup> speed_max: atomic<u32>;

@compute @workgroup_size(64)
fn update_grid(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    if (control.scatter == 0u) {
        return;
    }
    if (lane == 0u) {
        atomicStore(&speed_max, 0u);
    }
    workgroupBarrier();
    let block = nodes[group.x + group.y * groups.x];
    let node = block * 64u + lane;
    let quanta = sums[node];
    var velocity = vec3(0.0);
    var mass = 0.0;
    if (any(quanta != vec4(0))) {
        sums[node] = vec4(0);
    }
    if (any(abs(quanta) > vec4(SUM_MAX)) || quanta.w < 0) {
        atomicOr(&counters.faults, TOO_HEAVY);
    }
    if (quanta.w > 0) {
        mass = f32(quanta.w) / params.mass_scale;
        velocity = vec3<f32>(quanta.xyz) / (control.momentum_scale * mass) + params.gravity * control.dt;
        let friction = take_friction(node, quanta.w);
        let corner = vec3(
            block / (params.blocks.z * params.blocks.y),
            block / params.blocks.z % params.blocks.y,
            block % params.blocks.z,
        );
        let at = vec3<f32>(corner * 4u + vec3(lane / 16u, lane / 4u % 4u, lane % 4u));
        velocity = stop_all(at, velocity, friction);
        if (quanta.w >= SPEED_MASS_MIN) {
            let size = abs(velocity);
            atomicMax(&speed_max, bitcast<u32>(max(max(size.x, size.y), size.z)));
        }
    }
    velocities[node] = vec4(velocity, mass);
    workgroupBarrier();
    if (lane == 0u) {
        atomicMax(&counters.speed, atomicLoad(&speed_max));
    }
}
