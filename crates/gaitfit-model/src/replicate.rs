//! MJCF `<replicate>`: copies of bodies, each turned and shifted against the one before.
//!
//! As MuJoCo 4.0 expands it: the copies' names get `sep` and the copy's number, with as many digits as the count has.
//! Elements of other sections that refer to them are copied too. They follow the other elements, copy by copy.

use std::collections::HashSet;

use crate::attributes::{Attributes, Context};
use crate::error::ModelError;
use crate::options::Compiler;
use crate::orientation::{compose, read_orientation};
use crate::rotation::IDENTITY;
use crate::scan::MAX_NODES;
use crate::xml::{At, Attribute, Element};

/// Sections whose elements refer to bodies, joints, geoms and sites.
pub(crate) const REFERRING: [&str; 5] = ["contact", "actuator", "sensor", "tendon", "equality"];

/// Attributes of their elements that hold such a reference.
pub(crate) const REFERENCES: [&str; 19] = [
    "joint",
    "body",
    "geom",
    "site",
    "body1",
    "body2",
    "geom1",
    "geom2",
    "joint1",
    "joint2",
    "site1",
    "site2",
    "jointinparent",
    "objname",
    "refname",
    "refsite",
    "cranksite",
    "slidersite",
    "sidesite",
];

/// Names that a copy gave a suffix.
struct Copy {
    suffix: String,
    names: HashSet<String>,
}

impl Copy {
    /// Whether an attribute refers to something copied.
    fn has(&self, attribute: &Attribute) -> bool {
        REFERENCES.contains(&attribute.name.as_str()) && self.names.contains(&attribute.value)
    }
}

/// The document with all copies written out; `None` without any.
///
/// # Errors
/// Attributes that cannot be read, or more elements than a file may have.
pub(crate) fn expand(
    ctx: &mut Context,
    document: &Element,
    compiler: &Compiler,
) -> Result<Option<Element>, ModelError> {
    if !holds(document) {
        return Ok(None);
    }
    let mut expander = Expander { ctx, compiler, copies: Vec::new(), elements: 0 };
    let mut expanded = Element { children: Vec::new(), ..document.clone() };
    for section in &document.children {
        let children = match section.name.as_str() {
            "worldbody" => expander.children(section, None)?,
            _ => section.children.clone(),
        };
        expanded.children.push(Element { children, ..section.clone() });
    }
    // Only now are all copies known to which these sections may refer.
    for section in expanded.children.iter_mut().filter(|one| REFERRING.contains(&one.name.as_str())) {
        expander.refer(section)?;
    }
    Ok(Some(expanded))
}

fn holds(element: &Element) -> bool {
    element.name == "replicate" || element.children.iter().any(holds)
}

struct Expander<'c, 's> {
    ctx: &'c mut Context<'s>,
    compiler: &'c Compiler,
    copies: Vec<Copy>,
    /// Elements written so far.
    elements: usize,
}

impl Expander<'_, '_> {
    /// The children of an element; `copy`: the place in `copies` of the copy that it is part of.
    fn children(&mut self, element: &Element, copy: Option<usize>) -> Result<Vec<Element>, ModelError> {
        let mut children = Vec::new();
        for child in &element.children {
            if child.name == "replicate" {
                children.extend(self.replicate(child, copy)?);
                continue;
            }
            self.count(child.at)?;
            let mut copied = Element { children: self.children(child, copy)?, ..child.clone() };
            if let Some(copy) = copy {
                let copy = &mut self.copies[copy];
                for name in copied.attributes.iter_mut().filter(|attribute| attribute.name == "name") {
                    // Other sections refer to it by the name without the suffix.
                    copy.names.insert(name.value.clone());
                    name.value.push_str(&copy.suffix);
                }
            }
            children.push(copied);
        }
        Ok(children)
    }

    fn count(&mut self, at: At) -> Result<(), ModelError> {
        self.elements += 1;
        match self.elements > MAX_NODES {
            true => Err(self.ctx.too_many(at, "elements with those of <replicate>", MAX_NODES)),
            false => Ok(()),
        }
    }

    /// A frame for each copy.
    fn replicate(&mut self, element: &Element, outer: Option<usize>) -> Result<Vec<Element>, ModelError> {
        let mut a = Attributes::new(element);
        let count = a.integer(self.ctx, "count")?.and_then(|count| usize::try_from(count).ok());
        let Some(count) = count.filter(|count| *count > 0) else {
            let message = "<replicate> without a `count` above zero";
            return Err(self.ctx.invalid(a.at("count"), message, "add count=\"...\""));
        };
        let separator = a.text("sep").unwrap_or("").to_string();
        let (mut offset, mut turn) = ([0.0; 3], [0.0; 3]);
        a.set_array(self.ctx, "offset", &mut offset)?;
        a.set_array(self.ctx, "euler", &mut turn)?;
        a.finish(self.ctx)?;
        // MuJoCo fills with as many digits as the count itself has: 10 copies end in 00 to 09.
        let digits = count.to_string().len();
        let after = outer.map(|copy| self.copies[copy].suffix.clone()).unwrap_or_default();
        let mut pose = ([0.0; 3], IDENTITY);
        let mut frames = Vec::new();
        for number in 0..count {
            self.count(element.at)?;
            // Angles of the whole turn lose no precision.
            let euler = attribute("euler", &turn.map(|angle| angle * number as f64), element.at);
            let mut frame = Element {
                name: "frame".to_string(),
                attributes: vec![euler, attribute("pos", &pose.0, element.at)],
                children: Vec::new(),
                at: element.at,
            };
            let mut quat = IDENTITY;
            read_orientation(&mut Attributes::new(&frame), self.ctx, self.compiler.units, &mut quat)?;
            // Inside another copy the inner number comes before the outer one.
            let suffix = format!("{separator}{number:0digits$}{after}");
            self.copies.push(Copy { suffix, names: HashSet::new() });
            let copy = self.copies.len() - 1;
            frame.children = self.children(element, Some(copy))?;
            frames.push(frame);
            // The next copy stands one offset further, along the axes of this one.
            pose = compose((pose.0, quat), (offset, IDENTITY));
        }
        Ok(frames)
    }

    /// Copies the elements of a section that refer to something copied.
    fn refer(&mut self, section: &mut Element) -> Result<(), ModelError> {
        let refers = |element: &Element, copy: &Copy| {
            let named = |attribute: &Attribute| copy.has(attribute);
            element.attributes.iter().any(named)
                || element.children.iter().any(|inner| inner.attributes.iter().any(named))
        };
        // An element that refers to something copied exists only as copies.
        let (copied, mut kept): (Vec<Element>, Vec<Element>) = std::mem::take(&mut section.children)
            .into_iter()
            .partition(|element| self.copies.iter().any(|copy| refers(element, copy)));
        for number in 0..self.copies.len() {
            for element in &copied {
                if !refers(element, &self.copies[number]) {
                    continue;
                }
                self.count(element.at)?;
                let mut renamed = element.clone();
                let copy = &self.copies[number];
                for part in std::iter::once(&mut renamed.attributes)
                    .chain(renamed.children.iter_mut().map(|inner| &mut inner.attributes))
                {
                    for attribute in part.iter_mut() {
                        if attribute.name == "name" || copy.has(attribute) {
                            attribute.value.push_str(&copy.suffix);
                        }
                    }
                }
                kept.push(renamed);
            }
        }
        // Copies stand behind the elements that refer to nothing copied, as in MuJoCo.
        section.children = kept;
        Ok(())
    }
}

fn attribute(name: &str, values: &[f64], at: At) -> Attribute {
    // `to_string` writes every digit that is needed, so reading gives the same number again.
    let words: Vec<String> = values.iter().map(f64::to_string).collect();
    Attribute { name: name.to_string(), value: words.join(" "), at }
}
