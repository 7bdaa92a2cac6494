//! MJCF default classes: each starts as a copy of its parent and overwrites what it names.

use std::collections::HashMap;

use crate::actuator::{ActuatorForm, FOREIGN_KINDS, KINDS};
use crate::attributes::{Attributes, Context};
use crate::coupling::CouplingForm;
use crate::error::ModelError;
use crate::geom::GeomForm;
use crate::joint::JointForm;
use crate::model::ContactPair;
use crate::options::Compiler;
use crate::shown::shown;
use crate::site::SiteForm;
use crate::spec::default_pair;
use crate::xml::{At, Element};

/// The defaults of one class.
#[derive(Clone, Debug)]
pub(crate) struct Class {
    pub joint: JointForm,
    pub geom: GeomForm,
    pub site: SiteForm,
    pub pair: ContactPair,
    pub actuator: ActuatorForm,
    pub coupling: CouplingForm,
    /// Factors of meshes along their axes.
    pub mesh_scale: [f64; 3],
}

impl Default for Class {
    fn default() -> Self {
        Self {
            joint: JointForm::default(),
            geom: GeomForm::default(),
            site: SiteForm::default(),
            pair: default_pair(),
            actuator: ActuatorForm::default(),
            coupling: CouplingForm::default(),
            mesh_scale: [1.0; 3],
        }
    }
}

/// Name of a section of default classes that inherit from MuJoCo's own defaults, not from the file's. No element of a file
/// can have it.
pub(crate) const APART: &str = "default apart";

/// Max number of default classes of one file.
const MAX_CLASSES: usize = 512;

/// All classes of a file; index 0 is `main`, which applies where no class is named.
#[derive(Debug)]
pub(crate) struct Defaults {
    classes: Vec<Class>,
    names: HashMap<String, usize>,
}

impl Defaults {
    /// Only MuJoCo's own defaults.
    pub fn new() -> Self {
        Self { classes: vec![Class::default()], names: HashMap::from([("main".to_string(), 0)]) }
    }

    /// Class by index (as returned by [`Defaults::find`]).
    pub fn class(&self, index: usize) -> &Class {
        &self.classes[index]
    }

    /// The index of a class named by an element.
    ///
    /// # Errors
    /// The class does not exist.
    pub fn find(&self, ctx: &Context, at: At, name: &str) -> Result<usize, ModelError> {
        self.names.get(name).copied().ok_or_else(|| {
            ctx.invalid(
                at,
                format!("default class \"{}\" does not exist", shown(name)),
                "define it in <default>, or correct the name",
            )
        })
    }

    /// Reads a top-level `<default>` section.
    pub fn read(
        &mut self,
        ctx: &mut Context,
        element: &Element,
        compiler: &Compiler,
    ) -> Result<(), ModelError> {
        self.read_class(ctx, element, compiler, None)
    }

    fn read_class(
        &mut self,
        ctx: &mut Context,
        element: &Element,
        compiler: &Compiler,
        parent: Option<usize>,
    ) -> Result<(), ModelError> {
        let mut a = Attributes::new(element);
        let name = a.text("class").unwrap_or("");
        let at = a.at("class");
        let index = match parent {
            // The classes of an attached file have a top of their own beside `main`.
            None if element.name == APART => {
                if self.classes.len() >= MAX_CLASSES || self.names.contains_key(name) {
                    let message =
                        format!("default classes of two attached files are called \"{}\"", shown(name));
                    return Err(ctx.invalid(at, message, "give every <attach> a `prefix` of its own"));
                }
                // Not a copy of `main`: the other file does not inherit from this one.
                self.classes.push(Class::default());
                self.names.insert(name.to_string(), self.classes.len() - 1);
                self.classes.len() - 1
            }
            None if name.is_empty() || name == "main" => 0,
            None => {
                return Err(ctx.invalid(
                    at,
                    format!("the top-level default class is called \"{}\"", shown(name)),
                    "leave out its `class`, and put a named <default> inside it",
                ));
            }
            Some(_) if name.is_empty() || self.names.contains_key(name) => {
                return Err(ctx.invalid(
                    at,
                    format!("default class name \"{}\" is empty or repeated", shown(name)),
                    "give every nested <default> its own `class`",
                ));
            }
            Some(parent) => {
                if self.classes.len() >= MAX_CLASSES {
                    return Err(ctx.too_many(at, "default classes", MAX_CLASSES));
                }
                let outer = &self.classes[parent];
                let inner = Class { actuator: outer.actuator.inside(), ..outer.clone() };
                self.classes.push(inner);
                self.names.insert(name.to_string(), self.classes.len() - 1);
                self.classes.len() - 1
            }
        };
        a.finish(ctx)?;
        // A class's own entries come first, wherever the file has them: the classes inside begin as copies of it.
        for child in element.children.iter().filter(|c| c.name != "default") {
            read_entry(ctx, child, compiler, &mut self.classes[index])?;
        }
        for child in element.children.iter().filter(|c| c.name == "default") {
            self.read_class(ctx, child, compiler, Some(index))?;
        }
        Ok(())
    }
}

fn read_entry(
    ctx: &mut Context,
    element: &Element,
    compiler: &Compiler,
    class: &mut Class,
) -> Result<(), ModelError> {
    let mut a = Attributes::new(element);
    match element.name.as_str() {
        "joint" => class.joint.apply(ctx, &mut a)?,
        "geom" => class.geom.apply(ctx, &mut a, compiler)?,
        "site" => class.site.apply(ctx, &mut a, compiler)?,
        "pair" => crate::pairs::apply_pair(ctx, &mut a, &mut class.pair)?,
        kind if KINDS.contains(&kind) => class.actuator.apply(ctx, &mut a)?,
        // Only the scale of a mesh counts here, so its other attributes are passed over.
        "mesh" => {
            a.set_array(ctx, "scale", &mut class.mesh_scale)?;
            return Ok(());
        }
        "equality" => class.coupling.apply(ctx, &mut a)?,
        // Defaults of things that are ignored, or refused where they are used.
        "material" | "camera" | "light" | "tendon" => return Ok(()),
        kind if FOREIGN_KINDS.contains(&kind) => {
            return ctx.refuse(
                element.at,
                format!("defaults for <{kind}>"),
                "they change the defaults of every actuator in the class, and are not simulated",
                "use general, motor, position or velocity",
            );
        }
        _ => return ctx.refuse(element.at, element.label(), "not known in <default>", "remove it"),
    }
    a.finish(ctx)
}
