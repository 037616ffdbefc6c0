// Stub for scenes without image textures.

fn textures_met() -> TextureFactors {
    return NO_TEXTURES;
}
