//! Typed attributes of one element; what nobody asked for is refused at the end.

use crate::error::{ModelError, Place};
use crate::model::{Changed, Dropped};
use crate::shown::{shown, shown_number};
use crate::xml::{At, Element, Sources};

/// Entries listed in `Model::dropped`; more than this is a hostile or wrong file.
const MAX_DROPPED: usize = 2_000;
/// Largest number of a `solref`, for example of a stiffness: nothing is stiffer, and far larger numbers overflow.
const MAX_REFERENCE: f64 = 1e10;

/// State of a reader: positions for messages, leniency, and the list of what was left out.
pub(crate) struct Context<'s> {
    pub sources: &'s Sources,
    pub lenient: bool,
    /// Mend what can be mended and drop what the rest of the robot does without, as [`crate::ReadOptions::mend`] says.
    pub mend: bool,
    /// Weigh geoms that are meshes.
    pub weighs_meshes: bool,
    /// Folder of meshes from the file's, where the file names one.
    pub mesh_folder: String,
    /// Give a floating robot without a floor one.
    pub add_floor: bool,
    /// Let a floating robot that is clamped touch nothing of the world.
    pub in_the_air: bool,
    pub dropped: Vec<Dropped>,
    pub changed: Vec<Changed>,
}

impl Context<'_> {
    /// Lists something that the model leaves out without harm, strict or lenient.
    pub fn drop_quietly(&mut self, at: At, what: impl Into<String>, why: impl Into<String>) {
        self.list(at, what.into(), why.into(), true);
    }

    fn list(&mut self, at: At, what: String, why: String, harmless: bool) {
        // What is harmless is left out of a full list; `refuse` makes an error of one.
        if self.dropped.len() < MAX_DROPPED {
            let place = self.sources.place(at);
            self.dropped.push(Dropped { what, why, line: place.line, column: place.column, harmless });
        }
    }

    /// Lists something that reading added or mended.
    pub fn note(&mut self, at: At, what: impl Into<String>, how: impl Into<String>) {
        // A file with so many changes is read all the same; only the list ends here.
        if self.changed.len() < MAX_DROPPED {
            let Place { line, column, .. } = self.sources.place(at);
            self.changed.push(Changed { what: what.into(), how: how.into(), line, column });
        }
    }

    /// Refuses something that is not honoured; lenient reading lists it as dropped instead.
    ///
    /// # Errors
    /// [`ModelError::Unsupported`] unless lenient; [`ModelError::TooLarge`] when the list overflows.
    pub fn refuse(
        &mut self,
        at: At,
        what: impl Into<String>,
        why: impl Into<String>,
        remedy: &str,
    ) -> Result<(), ModelError> {
        let (what, why) = (what.into(), why.into());
        if !self.drops() {
            return Err(self.unsupported(at, &what, &why, remedy));
        }
        // All that changes the motion must be in the list, so a full list is an error here.
        if self.dropped.len() >= MAX_DROPPED {
            return Err(ModelError::TooLarge {
                place: self.sources.place(at),
                message: format!("more than {MAX_DROPPED} things to drop"),
                remedy: "this is not a robot file that can be read; simplify it".into(),
            });
        }
        self.list(at, what, why, false);
        Ok(())
    }

    /// Refuses a part whose removal would make another robot. A lenient reading lists it as dropped instead; a mending
    /// reading refuses it too.
    ///
    /// # Errors
    /// As [`Context::refuse`].
    pub fn refuse_unmended(
        &mut self,
        at: At,
        what: impl Into<String>,
        why: impl Into<String>,
        remedy: &str,
    ) -> Result<(), ModelError> {
        let (what, why) = (what.into(), why.into());
        if self.lenient {
            self.refuse(at, what, why, remedy)
        } else {
            Err(self.unsupported(at, &what, &why, remedy))
        }
    }

    /// Whether something that is refused in a strict reading is dropped.
    pub fn drops(&self) -> bool {
        self.lenient || self.mend
    }

    fn unsupported(&self, at: At, what: &str, why: &str, remedy: &str) -> ModelError {
        ModelError::Unsupported {
            place: self.sources.place(at),
            message: format!("{what}: {why}"),
            remedy: format!("{remedy}, or read leniently to drop it"),
        }
    }

    /// An error for a value that makes no valid robot.
    pub fn invalid(&self, at: At, message: impl Into<String>, remedy: impl Into<String>) -> ModelError {
        ModelError::Invalid { place: self.sources.place(at), message: message.into(), remedy: remedy.into() }
    }

    /// An error for more of something than a robot has.
    pub fn too_many(&self, at: At, what: &str, cap: usize) -> ModelError {
        ModelError::TooLarge {
            place: self.sources.place(at),
            message: format!("more than {cap} {what}"),
            remedy: "split the model, or remove what the simulation does not need".into(),
        }
    }
}

/// Reads the attributes of one element and remembers which were read.
pub(crate) struct Attributes<'e> {
    element: &'e Element,
    used: Vec<bool>,
}

impl<'e> Attributes<'e> {
    /// Starts with nothing read.
    pub fn new(element: &'e Element) -> Self {
        Self { element, used: vec![false; element.attributes.len()] }
    }

    /// The element.
    pub fn element(&self) -> &'e Element {
        self.element
    }

    /// Text of an attribute.
    pub fn text(&mut self, name: &str) -> Option<&'e str> {
        let index = self.element.attributes.iter().position(|a| a.name == name)?;
        // `finish` refuses every attribute without this mark.
        self.used[index] = true;
        Some(&self.element.attributes[index].value)
    }

    /// Where an attribute stands (the element's start when absent).
    pub fn at(&self, name: &str) -> At {
        self.element.attributes.iter().find(|a| a.name == name).map_or(self.element.at, |a| a.at)
    }

    /// Marks attributes without physical meaning as read.
    pub fn ignore(&mut self, names: &[&str]) {
        for name in names {
            self.text(name);
        }
    }

    /// All numbers of an attribute, each finite.
    pub fn numbers(&mut self, ctx: &Context, name: &str) -> Result<Option<Vec<f64>>, ModelError> {
        let Some(text) = self.text(name) else { return Ok(None) };
        let mut values = Vec::new();
        for word in text.split_whitespace() {
            match word.parse::<f64>() {
                // `parse` also accepts `inf` and `nan`.
                Ok(value) if value.is_finite() => values.push(value),
                _ => {
                    return Err(ctx.invalid(
                        self.at(name),
                        format!("`{name}` of {} has \"{}\"", self.element.label(), shown(word)),
                        "write finite numbers separated by spaces",
                    ));
                }
            }
        }
        Ok(Some(values))
    }

    /// Overwrites the first numbers of `target`, as many as the attribute has (at least one).
    /// Returns how many. MuJoCo reads short attributes this way: the rest keeps the class default.
    pub fn prefix(&mut self, ctx: &Context, name: &str, target: &mut [f64]) -> Result<usize, ModelError> {
        let Some(values) = self.numbers(ctx, name)? else { return Ok(0) };
        if values.is_empty() || values.len() > target.len() {
            return Err(ctx.invalid(
                self.at(name),
                format!("`{name}` of {} has {} numbers", self.element.label(), values.len()),
                format!("give 1 to {}", target.len()),
            ));
        }
        target[..values.len()].copy_from_slice(&values);
        Ok(values.len())
    }

    /// As [`Self::prefix`], the numbers of a `solref`.
    pub fn reference(&mut self, ctx: &Context, name: &str, target: &mut [f64; 2]) -> Result<(), ModelError> {
        self.prefix(ctx, name, target)?;
        let Some(large) = target.iter().find(|value| value.abs() > MAX_REFERENCE) else { return Ok(()) };
        Err(ctx.invalid(
            self.at(name),
            format!("`{name}` of {} has the number {}", self.element.label(), shown_number(*large)),
            format!("give numbers up to {MAX_REFERENCE:e}"),
        ))
    }

    /// Exactly `N` numbers.
    pub fn array<const N: usize>(
        &mut self,
        ctx: &Context,
        name: &str,
    ) -> Result<Option<[f64; N]>, ModelError> {
        let Some(values) = self.numbers(ctx, name)? else { return Ok(None) };
        match <[f64; N]>::try_from(values.as_slice()) {
            Ok(array) => Ok(Some(array)),
            Err(_) => Err(ctx.invalid(
                self.at(name),
                format!("`{name}` of {} has {} numbers", self.element.label(), values.len()),
                format!("give exactly {N}"),
            )),
        }
    }

    /// One number.
    pub fn number(&mut self, ctx: &Context, name: &str) -> Result<Option<f64>, ModelError> {
        Ok(self.array::<1>(ctx, name)?.map(|[value]| value))
    }

    /// Sets `target` when the attribute is present.
    pub fn set(&mut self, ctx: &Context, name: &str, target: &mut f64) -> Result<(), ModelError> {
        if let Some(value) = self.number(ctx, name)? {
            *target = value;
        }
        Ok(())
    }

    /// Sets an array when the attribute is present.
    pub fn set_array<const N: usize>(
        &mut self,
        ctx: &Context,
        name: &str,
        target: &mut [f64; N],
    ) -> Result<(), ModelError> {
        if let Some(value) = self.array(ctx, name)? {
            *target = value;
        }
        Ok(())
    }

    /// One number that must not be negative.
    pub fn set_nonnegative(&mut self, ctx: &Context, name: &str, target: &mut f64) -> Result<(), ModelError> {
        if let Some(value) = self.number(ctx, name)? {
            if value < 0.0 {
                return Err(ctx.invalid(
                    self.at(name),
                    format!("`{name}` of {} is {}", self.element.label(), shown_number(value)),
                    "give a value of zero or more",
                ));
            }
            *target = value;
        }
        Ok(())
    }

    /// A 32-bit integer.
    pub fn integer(&mut self, ctx: &Context, name: &str) -> Result<Option<i32>, ModelError> {
        let Some(text) = self.text(name) else { return Ok(None) };
        text.trim().parse().map(Some).map_err(|_| {
            ctx.invalid(
                self.at(name),
                format!("`{name}` of {} is \"{}\"", self.element.label(), shown(text)),
                "give a whole number",
            )
        })
    }

    /// One of the listed words, as its index.
    pub fn word(&mut self, ctx: &Context, name: &str, words: &[&str]) -> Result<Option<usize>, ModelError> {
        let Some(text) = self.text(name) else { return Ok(None) };
        match words.iter().position(|w| *w == text.trim()) {
            Some(index) => Ok(Some(index)),
            None => Err(ctx.invalid(
                self.at(name),
                format!("`{name}` of {} is \"{}\"", self.element.label(), shown(text)),
                format!("use one of {}", words.join(", ")),
            )),
        }
    }

    /// `true` or `false`.
    pub fn boolean(&mut self, ctx: &Context, name: &str) -> Result<Option<bool>, ModelError> {
        Ok(self.word(ctx, name, &["false", "true"])?.map(|index| index == 1))
    }

    /// Refuses a number array in which anything is not zero: the feature would change the physics.
    pub fn refuse_nonzero(
        &mut self,
        ctx: &mut Context,
        name: &str,
        why: &str,
        remedy: &str,
    ) -> Result<(), ModelError> {
        match self.numbers(ctx, name)? {
            // Zeros ask for nothing, so the engine honours them.
            Some(values) if values.iter().any(|v| *v != 0.0) => {
                ctx.refuse(self.at(name), format!("`{name}` of {}", self.element.label()), why, remedy)
            }
            _ => Ok(()),
        }
    }

    /// Refuses every attribute that was not read.
    pub fn finish(self, ctx: &mut Context) -> Result<(), ModelError> {
        for (attribute, used) in self.element.attributes.iter().zip(&self.used) {
            if !used {
                ctx.refuse(
                    attribute.at,
                    format!("`{}` of {}", shown(&attribute.name), self.element.label()),
                    "this attribute is not known here",
                    "correct or remove it",
                )?;
            }
        }
        Ok(())
    }
}
