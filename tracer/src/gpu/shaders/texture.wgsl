// Procedural textures: numbers on balls, wood, cloth, bricks, scoreboards, prints and cues (see
// `texture.rs`, also for the formulas).

fn stroke_distance(index: u32, p: vec2f) -> f32 {
    let ends = STROKE_ENDS[index];
    let arc = STROKE_ARCS[index];
    let q = p - ends.xy;
    if (arc.x > 0.0) {
        let length = sqrt(dot(q, q));
        return abs(length - arc.x) + select(9.0, 0.0, dot(q, ends.zw) >= arc.y * length);
    }
    let e = ends.zw - ends.xy;
    let share = clamp(dot(q, e) / max(dot(e, e), 1e-9), 0.0, 1.0);
    let d = q - share * e;
    return sqrt(dot(d, d));
}

fn is_digit(digit: u32, p: vec2f) -> bool {
    for (var stroke = 0u; stroke < STROKES; stroke++) {
        if (stroke_distance(digit * STROKES + stroke, p) < STROKE_HALF) {
            return true;
        }
    }
    return false;
}

fn is_ink(number: u32, p: vec2f) -> bool {
    if (number < 10u) {
        return is_digit(number, p / DIGIT_SCALE.x);
    }
    let q = p / DIGIT_SCALE.y;
    let shift = vec2f(DIGIT_SHIFT, 0.0);
    return is_digit(number / 10u, q + shift) || is_digit(number % 10u, q - shift);
}

fn in_circle(n: vec3f, axis: vec3f, up: vec3f) -> vec2f {
    let side = select(-1.0, 1.0, dot(n, axis) >= 0.0);
    return vec2f(dot(n, cross(up, axis)) * side, dot(n, up)) * (1.0 / CIRCLE_SINE);
}

fn is_in_circle(n: vec3f, axis: vec3f, up: vec3f) -> bool {
    let p = in_circle(n, axis, up);
    return dot(p, p) < 1.0;
}

fn numbered(number: u32, n: vec3f, axis: vec3f, up: vec3f, base: vec3f) -> vec3f {
    let p = in_circle(n, axis, up);
    if (dot(p, p) >= 1.0) {
        return base;
    }
    return select(CIRCLE_ALBEDO, INK_ALBEDO, is_ink(number, p));
}

// sin 2πt, by a polynomial on the first quarter.
fn wave(turns: f32) -> f32 {
    let x = turns - floor(turns + 0.5);
    // Folded into the first quarter by the symmetries of the sine.
    let t = min(abs(x), 0.5 - abs(x));
    let t2 = t * t;
    let c = SINE_OF_TURNS;
    let sine = t * (c.x + t2 * (c.y + t2 * (c.z + t2 * c.w)));
    return select(sine, -sine, x < 0.0);
}

fn faded(turns_per_m: f32, footprint_m: f32) -> f32 {
    let turns = min(turns_per_m * footprint_m, 1.0);
    let left = 1.0 - turns * turns;
    return left * left;
}

fn line_share(distance_m: f32, half_m: f32, footprint_m: f32) -> f32 {
    let half = half_m + 0.5 * footprint_m;
    return half_m / half * max(1.0 - distance_m / half, 0.0);
}

fn wood(material: u32, place: vec3f, footprint_m: f32) -> vec3f {
    var p = place;
    let light = scene_storage.materials[material].albedo;
    let rings = scene_storage.materials[material].stripe_albedo;
    let sights = scene_storage.materials[material].sights;
    var axis = scene_storage.materials[material].grain_axis;
    if (sights.y > 0.0) {
        let is_end = abs(p.x) - sights.y > abs(p.y) - sights.z;
        axis = select(0u, 1u, is_end);
        let along = select(p.x, p.y, is_end);
        let off = select(abs(p.y) - sights.z, abs(p.x) - sights.y, is_end);
        let nearest = floor(along / max(sights.x, 1e-6) + 0.5);
        let exists = sights.x > 0.0 && abs(nearest) < select(3.5, 1.5, is_end) && (is_end || nearest != 0.0);
        // A rhombus.
        let diamond = abs(along - nearest * sights.x) / SIGHT_HALF_M.x + abs(off) / SIGHT_HALF_M.y;
        if (exists && diamond < 1.0 && p.z > 0.0) {
            return SIGHT_ALBEDO;
        }
    }
    let scale = scene_storage.materials[material].scale;
    let footprint = footprint_m * scale;
    p *= scale;
    var a = select(p.x, p.y, axis == 1u);
    var b = select(p.y, p.x, axis == 1u);
    var height = p.z;
    if (axis == 2u) {
        a = p.z;
        b = p.x + p.y;
        height = 0.0;
    }
    var tone = 0.0;
    if (scene_storage.materials[material].pattern == PATTERN_PLANKS) {
        let across = b * (1.0 / PLANK_M);
        let plank = floor(across);
        if (across - plank < PLANK_GAP) {
            return 0.3 * rings;
        }
        tone = 0.28 * wave(0.381966 * plank);
        a += 1.7 * plank;
    }
    let bend = 0.45 * wave(0.61 * a + 0.2) + 0.2 * wave(1.7 * a + 2.3 * b);
    let ring = wave(17.0 * b + 11.0 * height + bend);
    let fibre = wave(151.0 * b + 83.0 * height + 0.8 * wave(1.3 * a + 3.1 * b) + 2.0 * a);
    let pore = wave(463.0 * b + 211.0 * height + 1.1 * wave(4.1 * a));
    let turns = WOOD_TURNS_PER_M;
    let grain = 0.27 * faded(turns.x, footprint) * ring + 0.14 * faded(turns.y, footprint) * fibre
        + 0.09 * faded(turns.z, footprint) * pore;
    return mix(light, rings, saturate(0.45 + grain + tone));
}

fn weave(u: f32, v: f32) -> f32 {
    let warp = wave(61.0 * v + 13.0 * u);
    let weft = wave(53.0 * u - 17.0 * v);
    return wave(WEAVE_PER_M * u + 0.3 * warp) * wave(WEAVE_PER_M * v + 0.3 * weft) * (0.75 + 0.25 * warp * weft);
}

fn lint(u: f32, v: f32, footprint_m: f32) -> f32 {
    let i = floor(u * (1.0 / LINT_SQUARE_M));
    let j = floor(v * (1.0 / LINT_SQUARE_M));
    let a = wave(0.381966 * i + 0.271828 * j);
    let b = wave(0.754878 * j - 0.137035 * i);
    let place = vec2f(u - (i + 0.5 + 0.4 * a) * LINT_SQUARE_M, v - (j + 0.5 + 0.4 * b) * LINT_SQUARE_M);
    let turns = 2.3 * a + 3.7 * b;
    let direction = vec2f(wave(turns + 0.25), wave(turns));
    let along = abs(dot(place, direction));
    let across = abs(place.x * direction.y - place.y * direction.x);
    return line_share(along, LINT_HALF_M.x, footprint_m) * line_share(across, LINT_HALF_M.y, footprint_m);
}

fn cloth(material: u32, p: vec3f, footprint_m: f32) -> vec3f {
    let most = scene_storage.materials[material].scale;
    let u = p.x + 0.3 * p.z;
    let v = p.y + 0.8 * p.z;
    let bend = wave(2.3 * u + 1.1 * v);
    let sway = wave(0.9 * u - 2.1 * v);
    let nap = wave(37.0 * v + 3.0 * bend) * wave(23.0 * u + 2.0 * sway);
    let shade = 1.0 + 0.05 * bend * sway + 0.015 * nap;
    let chalk = CHALK_ALBEDO * most;
    var colour = shade * scene_storage.materials[material].albedo;
    let of_weave = faded(WEAVE_FADES_PER_M, footprint_m);
    if (footprint_m > 0.0 && of_weave > 0.0) {
        colour *= 1.0 + WEAVE_SHARE * of_weave * weave(u, v);
        colour = mix(colour, chalk, LINT_SHARE * of_weave * lint(u, v, footprint_m));
    }
    if (abs(p.z) < MARK_REACH_M) {
        let line_x = scene_storage.materials[material].sights.x;
        let d_radius = scene_storage.materials[material].sights.y;
        let spots = scene_storage.materials[material].stripe_albedo;
        let along = p.x - spots.x;
        let from_foot = (along * along + p.y * p.y) / WORN_M2;
        colour = mix(colour, chalk, WORN_SHARE / (1.0 + from_foot));
        let from_line = p.x + line_x;
        let from_arc = sqrt(from_line * from_line + p.y * p.y) - d_radius;
        var off = select(T_MISS, abs(from_line), line_x > 0.0);
        if (d_radius > 0.0 && from_line < 0.0) {
            off = min(off, abs(from_arc));
        }
        colour = mix(colour, chalk, LINE_SHARE * line_share(off, LINE_HALF_M, footprint_m));
        let q = vec3f(p.x) - spots;
        var nearest = smallest(q * q) + p.y * p.y;
        if (line_x > 0.0) {
            let aside = abs(p.y) - d_radius;
            nearest = min(nearest, from_line * from_line + min(p.y * p.y, aside * aside));
        }
        if (nearest < SPOT_RADIUS_M * SPOT_RADIUS_M) {
            colour *= SPOT_SHARE;
        }
    }
    return min(colour, vec3f(most));
}

fn bricks(material: u32, p: vec3f) -> vec3f {
    let course = floor(p.z / BRICK_M.y);
    let along = (p.x + p.y) / BRICK_M.x + 0.5 * course;
    let brick = floor(along);
    if ((along - brick) * BRICK_M.x < JOINT_M || p.z - course * BRICK_M.y < JOINT_M) {
        return scene_storage.materials[material].sights;
    }
    let kiln = vec2f(wave(0.381966 * brick + 0.271 * course), wave(0.754878 * course - 0.137 * brick));
    let fired = 0.5 + 0.5 * wave(5.3 * kiln.x + 7.7 * kiln.y);
    let speckle = wave(31.0 * p.z + 1.3 * fired) * wave(17.0 * (p.x + p.y) + fired);
    let dark = clamp(fired + 0.12 * speckle, 0.0, 1.0);
    return mix(scene_storage.materials[material].albedo, scene_storage.materials[material].stripe_albedo, dark);
}

fn is_scoreboard_ink(place: vec2f) -> bool {
    let dial = clamp(floor(place.x / DIAL_SPACING + 0.5), -1.0, 1.0);
    let numbers = select(10u, 12u, dial == 0.0);
    let p = place - vec2f(DIAL_SPACING * dial, 0.0);
    let from_middle = length(p);
    if (from_middle > 1.0) {
        return true;
    }
    // Clockwise from the top; the built-in function is accurate enough to choose a number.
    let turns = atan2(p.x, p.y) * 0.15915494 + 1.0;
    var number = u32(turns * f32(numbers) + 0.5) % numbers;
    let direction = circle(f32(number) / f32(numbers)).yx;
    if (from_middle > DIAL_MARKS_FROM) {
        return abs(p.x * direction.y - p.y * direction.x) < DIAL_MARK_HALF;
    }
    if (number == 0u && numbers == 12u) {
        number = 12u;
    }
    return is_ink(number, (p - DIAL_NUMBERS_AT * direction) / DIAL_DIGIT);
}

fn scoreboard(material: u32, p: vec3f) -> vec3f {
    let place = scene_storage.materials[material].sights;
    let q = vec2f(place.x - p.y, p.z - place.y) / place.z;
    if (is_scoreboard_ink(q)) {
        return scene_storage.materials[material].stripe_albedo;
    }
    return scene_storage.materials[material].albedo;
}

fn print(material: u32, p: vec3f) -> vec3f {
    let q = (p - scene_storage.materials[material].sights) * scene_storage.materials[material].scale;
    let place = vec2f(q.x + q.y, q.z);
    if (any(abs(place) > PRINT_PAPER)) {
        return INK_ALBEDO;
    }
    if (any(abs(place) > PRINT_VIEW)) {
        return CIRCLE_ALBEDO;
    }
    let sky = scene_storage.materials[material].albedo;
    for (var range = 3.0; range > 0.0; range -= 1.0) {
        let ridge = 0.09 * wave((0.17 + 0.13 * range) * place.x + 0.37 * range)
            + 0.035 * wave((0.9 + 0.4 * range) * place.x + 0.61 * range);
        if (place.y < 0.33 - 0.25 * range + ridge) {
            return mix(sky, scene_storage.materials[material].stripe_albedo, range / 3.0);
        }
    }
    let from_sun = place - PRINT_SUN.xy;
    return select(sky, PRINT_SUN_ALBEDO, dot(from_sun, from_sun) < PRINT_SUN.z * PRINT_SUN.z);
}

fn cue(material: u32, from_tip_m: f32) -> vec3f {
    var part = 0u;
    for (var end = 0u; end < 6u; end++) {
        part += select(0u, 1u, from_tip_m >= CUE_ENDS_M[end]);
    }
    switch part {
        case 0u: { return CUE_TIP_ALBEDO; }
        case 1u: { return CUE_FERRULE_ALBEDO; }
        case 2u: { return scene_storage.materials[material].albedo; }
        case 3u: { return CUE_COLLAR_ALBEDO; }
        case 5u: { return CUE_WRAP_ALBEDO; }
        default: { return scene_storage.materials[material].stripe_albedo; }
    }
}

fn textured(surface: Surface, footprint_m: f32) -> vec3f {
    let pattern = scene_storage.materials[surface.material].pattern;
    if (pattern == PATTERN_WOOD || pattern == PATTERN_PLANKS) {
        return wood(surface.material, surface.position, footprint_m);
    }
    if (pattern == PATTERN_CLOTH) {
        return cloth(surface.material, surface.position, footprint_m);
    }
    if (pattern == PATTERN_BRICKS) {
        return bricks(surface.material, surface.position);
    }
    if (pattern == PATTERN_SCOREBOARD) {
        return scoreboard(surface.material, surface.position);
    }
    if (pattern == PATTERN_PRINT) {
        return print(surface.material, surface.position);
    }
    return surface.albedo;
}
