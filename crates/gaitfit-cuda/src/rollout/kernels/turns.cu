// Rotations in double precision.

struct Quat {
    double w, x, y, z;
};
DEVICE Quat product(Quat a, Quat b) {
    return {
        a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z, a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
        a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x, a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w};
}
DEVICE Quat turn(int axis, double angle) {
    double s = sin(0.5 * angle), c = cos(0.5 * angle);
    return {c, axis == 0 ? s : 0.0, axis == 1 ? s : 0.0, axis == 2 ? s : 0.0};
}
