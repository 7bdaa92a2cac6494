//! MJCF `<worldbody>`: bodies, frames, inertials, joints, geoms and sites, depth first.

use crate::attributes::{Attributes, Context};
use crate::defaults::Defaults;
use crate::error::ModelError;
use crate::inertia::{Inertial, combine};
use crate::inertial::{check_inertia, read_inertial};
use crate::joint::Finished;
use crate::mend::{Weight, balance, floats_by_parts, weigh};
use crate::options::{Compiler, InertiaFromGeom};
use crate::orientation::{compose, read_orientation};
use crate::outline::Meshes;
use crate::rotation::{IDENTITY, Quat, Vec3};
use crate::shown::shown;
use crate::spec::{BodySpec, MAX_BODIES, MAX_ITEMS, MAX_JOINTS};
use crate::terrain::Fields;
use crate::xml::{At, Element};

/// Reads bodies into a list that starts with the world.
pub(crate) struct BodyReader<'c, 's> {
    pub ctx: &'c mut Context<'s>,
    pub compiler: &'c Compiler,
    pub defaults: &'c Defaults,
    pub fields: &'c Fields,
    pub meshes: &'c Meshes,
    pub bodies: Vec<BodySpec>,
    joints: usize,
    geoms: usize,
    sites: usize,
}

/// State that enclosing bodies and frames hand down.
#[derive(Clone, Copy)]
struct Scope {
    body: usize,
    class: usize,
    /// Pose of the enclosing `<frame>` elements in the body.
    frame: (Vec3, Quat),
}

/// The part of a body's mass that one geom adds.
struct MassSource {
    /// `None` where it cannot be computed without the mesh.
    part: Option<Inertial>,
    weight: Weight,
    at: At,
    label: String,
    /// Whether it counts beside an explicit inertial, and without one.
    always: bool,
    auto: bool,
}

/// Elements of one body that give its mass.
#[derive(Default)]
struct MassSources {
    explicit: Option<Inertial>,
    /// Parts of the geoms, in the order of the body's geoms.
    geoms: Vec<MassSource>,
}

impl<'c, 's> BodyReader<'c, 's> {
    /// Starts with the world alone.
    pub fn new(
        ctx: &'c mut Context<'s>,
        compiler: &'c Compiler,
        defaults: &'c Defaults,
        fields: &'c Fields,
        meshes: &'c Meshes,
    ) -> Self {
        let world = BodySpec::new("world".to_string(), At::default(), 0);
        Self { ctx, compiler, defaults, fields, meshes, bodies: vec![world], joints: 0, geoms: 0, sites: 0 }
    }

    /// Reads one `<worldbody>` section.
    pub fn read_world(&mut self, element: &Element) -> Result<(), ModelError> {
        let mut a = Attributes::new(element);
        let class = self.class_of(&mut a, "childclass", 0)?;
        a.ignore(&["name"]);
        a.finish(self.ctx)?;
        let scope = Scope { body: 0, class, frame: ([0.0; 3], IDENTITY) };
        self.read_children(element, scope, &mut MassSources::default())
    }

    fn class_of(&self, a: &mut Attributes, attribute: &str, inherited: usize) -> Result<usize, ModelError> {
        match a.text(attribute) {
            Some(name) => self.defaults.find(self.ctx, a.at(attribute), name),
            None => Ok(inherited),
        }
    }

    fn read_children(
        &mut self,
        element: &Element,
        scope: Scope,
        mass: &mut MassSources,
    ) -> Result<(), ModelError> {
        for child in &element.children {
            let in_world = scope.body == 0;
            match child.name.as_str() {
                "body" => self.read_body(child, scope)?,
                "frame" => self.read_frame(child, scope, mass)?,
                "inertial" | "joint" | "freejoint" if in_world => {
                    return Err(self.ctx.invalid(
                        child.at,
                        format!("{} in the world", child.label()),
                        "put it into a body",
                    ));
                }
                "inertial" if scope.frame != ([0.0; 3], IDENTITY) => self.ctx.refuse(
                    child.at,
                    "<inertial> inside a moved <frame>",
                    "whether the frame moves it is ambiguous",
                    "put it directly into the body",
                )?,
                "inertial" => {
                    if mass.explicit.is_some() {
                        return Err(self.ctx.invalid(child.at, "second <inertial> of a body", "keep one"));
                    }
                    mass.explicit = Some(read_inertial(self.ctx, child, self.compiler.units)?);
                }
                // All of them together are the free joint that `read_body` has noted.
                "joint" if self.bodies[scope.body].free.is_some() && floats_by_parts(element) => {}
                "joint" => self.read_joint(child, scope)?,
                "freejoint" => {
                    let mut a = Attributes::new(child);
                    a.ignore(&["name", "group"]);
                    // MuJoCo aligns only bodies without children, which have no hinges to identify.
                    let alone = !element.children.iter().any(|c| c.name == "body" || c.name == "frame");
                    if a.word(self.ctx, "align", &["false", "true", "auto"])? == Some(1) && alone {
                        let at = a.at("align");
                        self.ctx.refuse(
                            at,
                            "`align` of <freejoint>",
                            "frames stay as written",
                            "remove it",
                        )?;
                    }
                    a.finish(self.ctx)?;
                    self.add_free(child, scope)?;
                }
                "geom" => self.read_geom(child, scope, mass)?,
                "site" => self.read_site(child, scope)?,
                // Only for pictures.
                "camera" | "light" => {}
                "composite" | "flexcomp" | "plugin" => self.ctx.refuse(
                    child.at,
                    child.label(),
                    "generated parts are not expanded",
                    "save the compiled model from MuJoCo and read that file",
                )?,
                _ => self.ctx.refuse(child.at, child.label(), "not known in a body", "remove it")?,
            }
        }
        Ok(())
    }

    fn read_frame(
        &mut self,
        element: &Element,
        scope: Scope,
        mass: &mut MassSources,
    ) -> Result<(), ModelError> {
        let mut a = Attributes::new(element);
        let class = self.class_of(&mut a, "childclass", scope.class)?;
        a.ignore(&["name"]);
        let pose = self.read_pose(&mut a)?;
        a.finish(self.ctx)?;
        let inner = Scope { class, frame: compose(scope.frame, pose), ..scope };
        self.read_children(element, inner, mass)
    }

    fn read_pose(&mut self, a: &mut Attributes) -> Result<(Vec3, Quat), ModelError> {
        let mut pos = [0.0; 3];
        let mut quat = IDENTITY;
        a.set_array(self.ctx, "pos", &mut pos)?;
        read_orientation(a, self.ctx, self.compiler.units, &mut quat)?;
        Ok((pos, quat))
    }

    fn read_body(&mut self, element: &Element, scope: Scope) -> Result<(), ModelError> {
        // The world is in the list too.
        if self.bodies.len() > MAX_BODIES {
            return Err(self.ctx.too_many(element.at, "bodies", MAX_BODIES));
        }
        let mut a = Attributes::new(element);
        let name = a.text("name").unwrap_or("").to_string();
        let class = self.class_of(&mut a, "childclass", scope.class)?;
        let pose = self.read_pose(&mut a)?;
        if a.boolean(self.ctx, "mocap")? == Some(true) {
            let at = a.at("mocap");
            self.ctx.refuse(at, format!("mocap {}", element.label()), "not simulated", "remove it")?;
        }
        a.refuse_nonzero(self.ctx, "gravcomp", "gravity compensation is not simulated", "remove it")?;
        a.ignore(&["user", "sleep", "simple"]);
        a.finish(self.ctx)?;

        let index = self.bodies.len();
        let mut body = BodySpec::new(name, element.at, scope.body);
        (body.pos, body.quat) = compose(scope.frame, pose);
        if self.ctx.mend && scope.body == 0 && floats_by_parts(element) {
            body.free = Some(element.at);
            let how = "it slides along three axes and turns about three: it floats here";
            self.ctx.note(element.at, format!("body \"{}\"", shown(&body.name)), how);
        }
        self.bodies.push(body);
        let mut mass = MassSources::default();
        // Frames end at a body: what it holds is placed in the body's own axes.
        let inner = Scope { body: index, class, frame: ([0.0; 3], IDENTITY) };
        self.read_children(element, inner, &mut mass)?;
        self.bodies[index].inertial = self.settle_mass(element, index, pose, mass)?;
        Ok(())
    }

    /// The body's inertia: explicit, or from its geoms, as `inertiafromgeom` says. `pose` is the body's own, as the
    /// file writes it.
    fn settle_mass(
        &mut self,
        element: &Element,
        index: usize,
        pose: (Vec3, Quat),
        mass: MassSources,
    ) -> Result<Inertial, ModelError> {
        let from_geoms = match self.compiler.inertia_from_geom {
            InertiaFromGeom::Always => true,
            InertiaFromGeom::Never => false,
            InertiaFromGeom::Auto => mass.explicit.is_none(),
        };
        // MuJoCo gives a body without inertia its own pose as the inertial frame. The frame sets where a bound mass
        // lies, and how soft the body's contacts are.
        let nothing = Inertial { pos: pose.0, quat: pose.1, ..crate::inertia::MASSLESS };
        let mut inertial = mass.explicit.unwrap_or(nothing);
        if from_geoms {
            let mut parts = Vec::new();
            for (place, source) in mass.geoms.iter().enumerate() {
                let counts = if mass.explicit.is_some() { source.always } else { source.auto };
                if !counts {
                    continue;
                }
                // Meshes are measured only where they are needed: that reads their files.
                let of_mesh = || {
                    let geom = self.bodies[index].geoms.get(place).filter(|_| self.ctx.weighs_meshes);
                    geom.and_then(|geom| weigh(geom, source.weight))
                };
                match source.part.or_else(of_mesh) {
                    Some(part) => parts.push(part),
                    None => self.ctx.refuse(
                        source.at,
                        format!("mass of {}", source.label),
                        format!(
                            "{} has no <inertial>, and this geom's mass is not computed",
                            element.label()
                        ),
                        "give the body an <inertial>, or the geom mass=\"0\"",
                    )?,
                }
            }
            // MuJoCo keeps an explicit inertial when no geom has a mass above `mjEPS`.
            if !parts.iter().all(|p| p.mass <= 1e-14) {
                inertial = combine(&parts);
            }
        }
        let c = self.compiler;
        // <compiler> may demand a least mass and least moments.
        inertial.mass = inertial.mass.max(c.bound_mass);
        inertial.inertia = inertial.inertia.map(|i| i.max(c.bound_inertia));
        // A mending reading takes the mean moment where others end with the error.
        check_inertia(self.ctx, element.at, &element.label(), inertial, c.balance_inertia)
            .or_else(|error| balance(self.ctx, element.at, &element.label(), inertial).ok_or(error))
    }

    fn read_joint(&mut self, element: &Element, scope: Scope) -> Result<(), ModelError> {
        let mut a = Attributes::new(element);
        let class = self.class_of(&mut a, "class", scope.class)?;
        let mut form = self.defaults.class(class).joint.clone();
        a.ignore(&["name"]);
        form.apply(self.ctx, &mut a)?;
        a.finish(self.ctx)?;
        match form.finish(self.ctx, element, self.compiler, scope.frame)? {
            Finished::Dropped => {}
            Finished::Free(free) => {
                self.add_free(element, scope)?;
                // A free joint that nothing resists needs no numbers.
                self.bodies[scope.body].free_joint = Some(free).filter(|free| !free.is_plain());
            }
            Finished::Moving(joint) => {
                self.joints += 1;
                if self.joints > MAX_JOINTS {
                    return Err(self.ctx.too_many(element.at, "joints", MAX_JOINTS));
                }
                let body = &mut self.bodies[scope.body];
                body.joints.push((*joint, element.at));
                // A rigid body has six degrees of freedom; MuJoCo refuses more too.
                if body.joints.len() > 6 || body.free.is_some() {
                    return Err(self.ctx.invalid(
                        element.at,
                        "more than six degrees of freedom in one body",
                        "spread the joints over more bodies",
                    ));
                }
            }
        }
        Ok(())
    }

    fn add_free(&mut self, element: &Element, scope: Scope) -> Result<(), ModelError> {
        let body = &mut self.bodies[scope.body];
        if body.parent != 0 || body.free.is_some() || !body.joints.is_empty() {
            return Err(self.ctx.invalid(
                element.at,
                "a free joint below another body, or beside another joint",
                "a free joint stands alone, in a child of the world",
            ));
        }
        body.free = Some(element.at);
        Ok(())
    }

    fn read_geom(
        &mut self,
        element: &Element,
        scope: Scope,
        mass: &mut MassSources,
    ) -> Result<(), ModelError> {
        self.geoms += 1;
        if self.geoms > MAX_ITEMS {
            return Err(self.ctx.too_many(element.at, "geoms", MAX_ITEMS));
        }
        let mut a = Attributes::new(element);
        let class = self.class_of(&mut a, "class", scope.class)?;
        let mut form = self.defaults.class(class).geom.clone();
        a.ignore(&["name"]);
        form.apply(self.ctx, &mut a, self.compiler)?;
        a.finish(self.ctx)?;
        for child in &element.children {
            self.ctx.refuse(child.at, child.label(), "geom plugins are not simulated", "remove it")?;
        }
        let (mut geom, part) = form.finish(self.ctx, element, self.fields, self.meshes)?;
        // The file states poses in the innermost frame; from here on they are in the body's.
        (geom.pos, geom.quat) = compose(scope.frame, (geom.pos, geom.quat));
        let part = part.map(|p| {
            let (pos, quat) = compose(scope.frame, (p.pos, p.quat));
            Inertial { pos, quat, ..p }
        });
        // An <inertial> may come after the geoms, so the answers for both cases are kept.
        let counts = |explicit| form.counts(self.compiler, explicit);
        mass.geoms.push(MassSource {
            part,
            weight: form.weight(),
            at: element.at,
            label: element.label(),
            always: counts(true),
            auto: counts(false),
        });
        self.bodies[scope.body].geoms.push(geom);
        Ok(())
    }

    fn read_site(&mut self, element: &Element, scope: Scope) -> Result<(), ModelError> {
        self.sites += 1;
        if self.sites > MAX_ITEMS {
            return Err(self.ctx.too_many(element.at, "sites", MAX_ITEMS));
        }
        let mut a = Attributes::new(element);
        let class = self.class_of(&mut a, "class", scope.class)?;
        let mut form = self.defaults.class(class).site.clone();
        a.ignore(&["name"]);
        form.apply(self.ctx, &mut a, self.compiler)?;
        a.finish(self.ctx)?;
        let site = form.finish(self.ctx, element, scope.frame)?;
        self.bodies[scope.body].sites.push(site);
        Ok(())
    }
}
