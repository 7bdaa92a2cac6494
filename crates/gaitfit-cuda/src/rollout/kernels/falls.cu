// Contacts and falls.

DEVICE bool touches(const float* report, u32 e, int geom) { return FORCE(geom) > TOUCH; }

DEVICE bool has_fallen(const float* report, u32 e, float uprightness, float height) {
    bool fallen = uprightness < MIN_UPRIGHTNESS || height < MIN_HEIGHT;
    for (int k = 0; k < FALL_GEOMS; k++) fallen |= touches(report, e, FALL_GEOM[k]);
    return fallen;
}

