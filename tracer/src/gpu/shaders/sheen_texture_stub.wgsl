// Stub for sheens without textures.

fn texture_sheen() {}
