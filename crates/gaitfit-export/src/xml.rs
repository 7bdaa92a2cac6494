//! Changes of an XML file as text, so that all else in it stays as it is.

use gaitfit_settings::Error;
use roxmltree::Node;
use std::ops::Range;

/// Changes to a text, made all at once.
#[derive(Debug, Default)]
pub(super) struct Edits {
    edits: Vec<(Range<usize>, String)>,
}

impl Edits {
    /// Sets an attribute of an element.
    pub fn set(&mut self, text: &str, node: Node<'_, '_>, name: &str, value: &str) {
        if let Some(attribute) = node.attributes().find(|attribute| attribute.name() == name) {
            self.edits.push((attribute.range_value(), value.to_owned()));
            return;
        }
        // After the tag's name.
        let start = node.range().start + 1;
        let rest = &text[start..node.range().end];
        let name_end = rest.find(|c: char| c.is_whitespace() || c == '>' || c == '/').unwrap_or(rest.len());
        self.edits.push((start + name_end..start + name_end, format!(" {name}=\"{value}\"")));
    }

    /// Takes an attribute out of an element, if it has it.
    pub fn remove(&mut self, node: Node<'_, '_>, name: &str) {
        if let Some(attribute) = node.attributes().find(|attribute| attribute.name() == name) {
            self.edits.push((attribute.range(), String::new()));
        }
    }

    /// Puts a text at the end of an element, which may have nothing in it yet.
    pub fn append(&mut self, text: &str, node: Node<'_, '_>, inner: String) {
        let Range { start, end } = node.range();
        match text[start..end].rfind("</") {
            // The last closing tag within an element's text is its own.
            Some(close) if !text[start..end].ends_with("/>") => self.insert(start + close, inner),
            // `<tag ... />`
            _ => {
                let name = node.tag_name().name();
                self.edits.push((end - "/>".len()..end, format!(">{inner}</{name}>")));
            }
        }
    }

    /// Puts a text at a place.
    pub fn insert(&mut self, at: usize, text: String) {
        self.edits.push((at..at, text));
    }

    /// Replaces an element.
    pub fn replace(&mut self, node: Node<'_, '_>, text: String) {
        self.edits.push((node.range(), text));
    }

    /// The changed text.
    pub fn apply(mut self, text: &str) -> String {
        // Changes at one place keep their order.
        self.edits.sort_by_key(|(range, _)| range.start);
        let mut out = String::with_capacity(text.len() + 256);
        let mut at = 0;
        for (range, new) in self.edits {
            // Inside an element that was replaced as a whole.
            if range.start < at {
                continue;
            }
            out.push_str(&text[at..range.start]);
            out.push_str(&new);
            at = range.end;
        }
        out.push_str(&text[at..]);
        out
    }
}

/// A number as XML has it.
pub(super) fn number(value: f64) -> String {
    // The shortest text that reads back as the same number.
    format!("{value:?}")
}

/// Numbers of an attribute.
pub(super) fn numbers(node: Node<'_, '_>, name: &str) -> Option<Vec<f64>> {
    node.attribute(name)?.split_whitespace().map(|word| word.parse().ok()).collect()
}

/// Parses a robot file that its reader has read already.
pub(super) fn parse(text: &str) -> Result<roxmltree::Document<'_>, Error> {
    // Some robot files have a document type, which the parser refuses by default.
    let options = roxmltree::ParsingOptions { allow_dtd: true, ..roxmltree::ParsingOptions::default() };
    roxmltree::Document::parse_with_options(text, options)
        .map_err(|error| Error::failed(format!("the robot's file: {error}")))
}
