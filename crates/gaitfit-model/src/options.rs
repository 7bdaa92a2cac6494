//! MJCF `<compiler>` and `<option>`.

use crate::attributes::{Attributes, Context};
use crate::error::ModelError;
use crate::model::{Cone, Integrator, Options};
use crate::orientation::AngleUnits;
use crate::shown::shown_number;
use crate::spec::Disabled;
use crate::xml::Element;

/// `<compiler>` with MuJoCo's defaults.
#[derive(Clone, Debug)]
pub(crate) struct Compiler {
    pub units: AngleUnits,
    pub autolimits: bool,
    pub inertia_from_geom: InertiaFromGeom,
    /// Geom groups that count for inertia.
    pub inertia_groups: [i32; 2],
    pub balance_inertia: bool,
    pub bound_mass: f64,
    pub bound_inertia: f64,
    pub total_mass: Option<f64>,
    /// Folder of meshes and height fields, from the file's.
    pub mesh_folder: String,
}

/// `compiler inertiafromgeom`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum InertiaFromGeom {
    Never,
    Always,
    Auto,
}

impl Default for Compiler {
    fn default() -> Self {
        Self {
            units: AngleUnits::default(),
            autolimits: true,
            inertia_from_geom: InertiaFromGeom::Auto,
            // MuJoCo's groups are 0 to 5, so by default every geom counts.
            inertia_groups: [0, 5],
            balance_inertia: false,
            bound_mass: 0.0,
            bound_inertia: 0.0,
            total_mass: None,
            mesh_folder: String::new(),
        }
    }
}

impl Compiler {
    /// The first setting by which `other` reads numbers differently.
    pub fn differs(&self, other: &Self) -> Option<&'static str> {
        let checks = [
            ("angle", self.units.degree == other.units.degree),
            ("eulerseq", self.units.eulerseq == other.units.eulerseq),
            ("autolimits", self.autolimits == other.autolimits),
            ("inertiafromgeom", self.inertia_from_geom == other.inertia_from_geom),
            ("inertiagrouprange", self.inertia_groups == other.inertia_groups),
            ("balanceinertia", self.balance_inertia == other.balance_inertia),
            ("boundmass", self.bound_mass == other.bound_mass),
            ("boundinertia", self.bound_inertia == other.bound_inertia),
        ];
        checks.into_iter().find(|(_, same)| !same).map(|(setting, _)| setting)
    }

    /// Reads one `<compiler>` element over the present values.
    pub fn read(&mut self, ctx: &mut Context, element: &Element) -> Result<(), ModelError> {
        let mut a = Attributes::new(element);
        // The places in these lists of words are the values: `degree` is 1.
        if let Some(degree) = a.word(ctx, "angle", &["radian", "degree"])? {
            self.units.degree = degree == 1;
        }
        if let Some(text) = a.text("eulerseq") {
            let letters = <[u8; 3]>::try_from(text.as_bytes()).ok();
            match letters.filter(|l| l.iter().all(|c| b"xyzXYZ".contains(c))) {
                Some(letters) => self.units.eulerseq = letters,
                None => {
                    return Err(ctx.invalid(
                        a.at("eulerseq"),
                        "`eulerseq` is not three of x, y, z, X, Y, Z",
                        "write for example eulerseq=\"xyz\"",
                    ));
                }
            }
        }
        if let Some(on) = a.boolean(ctx, "autolimits")? {
            self.autolimits = on;
        }
        if let Some(mode) = a.word(ctx, "inertiafromgeom", &["false", "true", "auto"])? {
            self.inertia_from_geom =
                [InertiaFromGeom::Never, InertiaFromGeom::Always, InertiaFromGeom::Auto][mode];
        }
        if let Some(groups) = a.array::<2>(ctx, "inertiagrouprange")? {
            self.inertia_groups = groups.map(|g| g as i32);
        }
        if let Some(on) = a.boolean(ctx, "balanceinertia")? {
            self.balance_inertia = on;
        }
        a.set_nonnegative(ctx, "boundmass", &mut self.bound_mass)?;
        a.set_nonnegative(ctx, "boundinertia", &mut self.bound_inertia)?;
        if let Some(mass) = a.number(ctx, "settotalmass")? {
            // Zero and less leave the masses as they are.
            self.total_mass = (mass > 0.0).then_some(mass);
        }
        if a.word(ctx, "coordinate", &["local", "global"])? == Some(1) {
            return Err(ctx.invalid(
                a.at("coordinate"),
                "global coordinates are not supported (nor by MuJoCo since 2.3.4)",
                "save the model with local coordinates",
            ));
        }
        if a.boolean(ctx, "fusestatic")? == Some(true) {
            let at = a.at("fusestatic");
            ctx.drop_quietly(at, "`fusestatic`", "bodies without joints are kept; the dynamics are the same");
        }
        // The later one counts: `meshdir` is more precise than `assetdir`.
        for name in ["assetdir", "meshdir"] {
            if let Some(folder) = a.text(name) {
                self.mesh_folder = folder.to_string();
            }
        }
        // Where files lie, how compilation runs, what is drawn: no physics.
        a.ignore(&["strippath", "meshdir", "texturedir", "assetdir", "usethread", "discardvisual"]);
        a.ignore(&["fitaabb", "saveinertial", "alignfree", "conflict"]);
        for child in element.children.iter().filter(|c| c.name != "lengthrange") {
            ctx.refuse(child.at, child.label(), "not known in <compiler>", "remove it")?;
        }
        a.finish(ctx)
    }
}

/// Gravity on Earth as MuJoCo has it by default, m/s².
pub const GRAVITY: f64 = 9.81;

/// MuJoCo's default options.
pub(crate) fn default_options() -> Options {
    Options {
        timestep: 0.002,
        gravity: [0.0, 0.0, -GRAVITY],
        cone: Cone::Pyramidal,
        impratio: 1.0,
        integrator: Integrator::Euler,
        iterations: 100,
        ls_iterations: 50,
        eulerdamp: true,
    }
}

/// Reads one `<option>` element over the present values.
pub(crate) fn read_option(
    ctx: &mut Context,
    element: &Element,
    options: &mut Options,
    disabled: &mut Disabled,
) -> Result<(), ModelError> {
    let mut a = Attributes::new(element);
    for (name, target) in [("timestep", &mut options.timestep), ("impratio", &mut options.impratio)] {
        a.set(ctx, name, target)?;
        if *target <= 0.0 {
            return Err(ctx.invalid(
                a.at(name),
                format!("`{name}` is {}", shown_number(*target)),
                "give a value above zero",
            ));
        }
    }
    a.set_array(ctx, "gravity", &mut options.gravity)?;
    if let Some(cone) = a.word(ctx, "cone", &["pyramidal", "elliptic"])? {
        options.cone = [Cone::Pyramidal, Cone::Elliptic][cone];
    }
    let integrators = ["Euler", "implicitfast", "RK4", "implicit"];
    match a.word(ctx, "integrator", &integrators)? {
        Some(0) => options.integrator = Integrator::Euler,
        Some(1) => options.integrator = Integrator::ImplicitFast,
        Some(other) => {
            ctx.refuse(
                a.at("integrator"),
                format!("integrator {}", integrators[other]),
                "only Euler and implicitfast are implemented; a lenient reading takes Euler",
                "use integrator=\"implicitfast\" or \"Euler\"",
            )?;
            // Only a reading that drops things comes here.
            options.integrator = Integrator::Euler;
        }
        None => {}
    }
    for (name, target) in
        [("iterations", &mut options.iterations), ("ls_iterations", &mut options.ls_iterations)]
    {
        if let Some(count) = a.integer(ctx, name)? {
            *target = u32::try_from(count)
                .map_err(|_| ctx.invalid(a.at(name), format!("`{name}` is {count}"), "give zero or more"))?;
        }
    }
    let solvers = ["Newton", "CG", "PGS"];
    // 0 is Newton's method, which is used here.
    if let Some(solver) = a.word(ctx, "solver", &solvers)?.filter(|&s| s > 0) {
        let at = a.at("solver");
        ctx.drop_quietly(
            at,
            format!("solver {}", solvers[solver]),
            "Newton's method is used; the converged solution is the same",
        );
    }
    for name in ["density", "viscosity", "wind"] {
        a.refuse_nonzero(ctx, name, "fluid forces are not simulated", "remove it")?;
    }
    a.refuse_nonzero(ctx, "noslip_iterations", "the no-slip pass is not implemented", "remove it")?;
    // An empty list disables nothing.
    if a.text("actuatorgroupdisable").is_some_and(|t| !t.trim().is_empty()) {
        let at = a.at("actuatorgroupdisable");
        ctx.refuse(at, "`actuatorgroupdisable`", "all actuators are used", "remove those actuators")?;
    }
    // Tolerances are settings of the solver here; the o_ values act only under flag override, refused below.
    a.ignore(&["tolerance", "ls_tolerance", "noslip_tolerance", "ccd_tolerance", "sleep_tolerance"]);
    a.ignore(&["magnetic", "jacobian", "ccd_iterations", "sdf_iterations", "sdf_initpoints"]);
    a.ignore(&["o_margin", "o_solref", "o_solimp", "o_friction", "apirate"]);
    a.finish(ctx)?;
    for child in &element.children {
        if child.name == "flag" {
            read_flag(ctx, child, options, disabled)?;
        } else {
            ctx.refuse(child.at, child.label(), "not known in <option>", "remove it")?;
        }
    }
    Ok(())
}

fn read_flag(
    ctx: &mut Context,
    element: &Element,
    options: &mut Options,
    disabled: &mut Disabled,
) -> Result<(), ModelError> {
    const SWITCH: [&str; 2] = ["disable", "enable"];
    let mut a = Attributes::new(element);
    let off = |a: &mut Attributes, ctx: &Context, name: &str, target: &mut bool| {
        a.word(ctx, name, &SWITCH).map(|value| {
            if let Some(value) = value {
                *target = value == 0;
            }
        })
    };
    let mut constraint = false;
    let mut passive = false;
    off(&mut a, ctx, "constraint", &mut constraint)?;
    off(&mut a, ctx, "passive", &mut passive)?;
    off(&mut a, ctx, "contact", &mut disabled.contact)?;
    off(&mut a, ctx, "equality", &mut disabled.equality)?;
    off(&mut a, ctx, "limit", &mut disabled.limit)?;
    off(&mut a, ctx, "frictionloss", &mut disabled.frictionloss)?;
    off(&mut a, ctx, "spring", &mut disabled.spring)?;
    off(&mut a, ctx, "damper", &mut disabled.damper)?;
    off(&mut a, ctx, "gravity", &mut disabled.gravity)?;
    off(&mut a, ctx, "clampctrl", &mut disabled.clampctrl)?;
    off(&mut a, ctx, "filterparent", &mut disabled.filterparent)?;
    // These two switch off whole families, whatever the flags of their members say.
    if constraint {
        disabled.contact = true;
        disabled.equality = true;
        disabled.limit = true;
        disabled.frictionloss = true;
    }
    if passive {
        disabled.spring = true;
        disabled.damper = true;
    }
    if let Some(value) = a.word(ctx, "eulerdamp", &SWITCH)? {
        options.eulerdamp = value == 1;
    }
    for name in ["actuation", "refsafe"] {
        if a.word(ctx, name, &SWITCH)? == Some(0) {
            ctx.refuse(a.at(name), format!("flag {name}=\"disable\""), "always on here", "remove it")?;
        }
    }
    for name in ["override", "diagexact", "fwdinv"] {
        // `fwdinv` only compares forward with inverse dynamics, which leaves the motion as it is.
        if a.word(ctx, name, &SWITCH)? == Some(1) && name != "fwdinv" {
            ctx.refuse(a.at(name), format!("flag {name}=\"enable\""), "not implemented", "remove it")?;
        }
    }
    // Diagnostics, collision search, memory: the motion stays the same.
    a.ignore(&["warmstart", "sensor", "sensornoise", "midphase", "autoreset", "nativeccd", "island"]);
    a.ignore(&["multiccd", "energy", "invdiscrete", "sleep"]);
    a.finish(ctx)
}
