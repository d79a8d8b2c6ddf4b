//! Target properties of a program.

use hprm_model::Span;
use hprm_model::declaration::{self, Element, ElementKind, Expression, ExpressionKind, Name};

use crate::Malformed;
use crate::document::{NamedValue, Property, Value};
use crate::places::Places;

/// The properties, for the library. All of a value has the place of its property.
pub(crate) fn properties(
    properties: &[Property],
    places: &Places,
) -> Result<Vec<declaration::Property>, Malformed> {
    let property = |property: &Property| {
        let span = places.span(property.at)?;
        let name = Name::new(property.name.as_str(), span);
        Ok(declaration::Property { name, value: element(&property.value, span, places)? })
    };
    properties.iter().map(property).collect()
}

fn element(value: &Value, span: Span, places: &Places) -> Result<Element, Malformed> {
    let literal = |kind| ElementKind::Value(Expression { kind, span });
    let kind = match value {
        Value::Bool(truth) => literal(ExpressionKind::Bool(*truth)),
        Value::Integer(number) => literal(ExpressionKind::Integer(*number)),
        Value::Named(NamedValue::Time(nanos)) => literal(ExpressionKind::Time(*nanos)),
        Value::Named(NamedValue::Text(text)) => literal(ExpressionKind::String(text.clone())),
        Value::Named(NamedValue::Word(word)) => ElementKind::Path(word.clone()),
        Value::Named(NamedValue::List(values)) => {
            let elements = values.iter().map(|value| element(value, span, places));
            ElementKind::List(elements.collect::<Result<_, _>>()?)
        }
        Value::Named(NamedValue::Dictionary(entries)) => {
            ElementKind::Dictionary(properties(entries, places)?)
        }
    };
    Ok(Element { kind, span })
}
