// What the tables of a task and its robot hold.

// Constant memory serves one address of a warp at a time. A TABLE is for rows that all threads read together; a LOOKUP for rows
// that each thread chooses.
#ifndef GAITFIT_HOST
#define TABLE __constant__
#define LOOKUP __device__ const
#else
#define TABLE static const
#define LOOKUP static const
#endif

// A number of the robot at place `i` of a tile of robots lies `base + stride i` into the tile's numbers.
struct Spot {
    int base, stride;
};
// A term of an observation: its quantity, first place of its present frame in the row, numbers of a frame, its noise's
// first draw and half range, the first place of its oldest frame, how far apart frames are, and how many it has.
struct Term {
    int quantity, place, width, draw;
    float half_range;
    int oldest, apart, frames;
};
// A row: its first term and their number, the first of its scales, its width, and the most frames of a term, one more
// with an earlier action.
struct Row {
    int first, terms, scale, width, frames;
};
// A joint: its position at its reference, its range, and whether it slides.
struct Joint {
    double reference;
    int limited;
    double range[2];
    int slides;
};
// A joint that follows another one (leader -1: it is held): its distance from its reference by powers of the leader's.
struct Coupling {
    int follower, leader;
    double polynomial[5];
};
// A part of the way from the base to a geom: whether a body's frame in its parent's comes first, and that frame; then a joint
// (-1: none), its anchor and axis in the body's frame, and whether it slides.
struct Link {
    int framed;
    double position[3], quaternion[4];
    int joint, slides;
    double anchor[3], axis[3];
};
// A geom that may touch the ground: the way to it in WAY_TO, and how far it reaches from its centre.
struct Shape {
    int first, links;
    double position[3], radius, edges[9], rim, axis[3];
    // Whether it is a sphere or a capsule.
    int round;
};

