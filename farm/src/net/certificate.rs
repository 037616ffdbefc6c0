//! Verification of a peer's certificate: authority, validity, role, deny list.

use std::sync::Arc;

use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::crypto::CryptoProvider;
use rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use rustls::server::WebPkiClientVerifier;
use rustls::server::danger::{ClientCertVerified, ClientCertVerifier};
use rustls::{
    CertificateError, DigitallySignedStruct, DistinguishedName, Error, RootCertStore,
    SignatureScheme,
};
use x509_parser::extensions::GeneralName;
use x509_parser::prelude::{FromDer, X509Certificate};

use crate::net::deny_list::DenyList;
use crate::net::peer::{CertificateFault, Role};

/// Verifies one's own certificate as a peer would: issued by `authority`, valid at `now`, of the given role.
pub(crate) fn verify_own(
    authority: &CertificateDer<'_>,
    certificate: &CertificateDer<'_>,
    role: Role,
    denied: &Arc<DenyList>,
    now: UnixTime,
) -> Result<(), CertificateFault> {
    PeerVerifier::new(authority, role, Arc::clone(denied))
        .and_then(|verifier| verifier.verify(certificate, &[], now))
        .map_err(|error| own_fault(&error, role))
}

fn own_fault(error: &Error, role: Role) -> CertificateFault {
    let Error::InvalidCertificate(fault) = error else {
        return CertificateFault::Unusable(error.to_string());
    };
    match fault {
        CertificateError::Expired | CertificateError::ExpiredContext { .. } => {
            CertificateFault::Expired(role)
        }
        CertificateError::NotValidYet | CertificateError::NotValidYetContext { .. } => {
            CertificateFault::NotYetValid
        }
        CertificateError::Revoked => CertificateFault::Revoked,
        CertificateError::InvalidPurpose
        | CertificateError::InvalidPurposeContext { .. }
        | CertificateError::ApplicationVerificationFailure => CertificateFault::WrongRole(role),
        CertificateError::UnknownIssuer | CertificateError::BadSignature => {
            CertificateFault::OtherAuthority
        }
        fault => CertificateFault::Unusable(fault.to_string()),
    }
}

pub(crate) fn provider() -> Arc<CryptoProvider> {
    Arc::new(rustls::crypto::ring::default_provider())
}

/// Whether a certificate states this role and no other.
fn grants(certificate: &[u8], role: Role) -> bool {
    let Ok((_, parsed)) = X509Certificate::from_der(certificate) else {
        return false;
    };
    let Ok(Some(names)) = parsed.subject_alternative_name() else {
        return false;
    };
    let mut roles = names
        .value
        .general_names
        .iter()
        .filter_map(|name| match name {
            GeneralName::URI(uri) if uri.starts_with("carom://role/") => Some(*uri),
            _ => None,
        });
    roles.next() == Some(role.uri()) && roles.next().is_none()
}

/// TLS verifier that accepts peers of one role of one farm whose keys are not on the deny list.
#[derive(Debug)]
pub(crate) struct PeerVerifier {
    role: Role,
    denied: Arc<DenyList>,
    /// Whether a client without a certificate is refused.
    mandatory: bool,
    roots: Arc<RootCertStore>,
    players: Arc<dyn ClientCertVerifier>,
    provider: Arc<CryptoProvider>,
}

impl PeerVerifier {
    pub(crate) fn new(
        authority: &CertificateDer<'_>,
        role: Role,
        denied: Arc<DenyList>,
    ) -> Result<Self, Error> {
        let mut roots = RootCertStore::empty();
        roots.add(authority.clone().into_owned())?;
        let (roots, provider) = (Arc::new(roots), provider());
        let players = WebPkiClientVerifier::builder_with_provider(roots.clone(), provider.clone())
            .build()
            .map_err(|error| Error::General(error.to_string()))?;
        Ok(Self {
            role,
            denied,
            mandatory: true,
            roots,
            players,
            provider,
        })
    }

    /// As this verifier, but a client may present no certificate at all.
    pub(crate) fn optional(self) -> Self {
        Self {
            mandatory: false,
            ..self
        }
    }

    fn verify(
        &self,
        certificate: &CertificateDer<'_>,
        intermediates: &[CertificateDer<'_>],
        now: UnixTime,
    ) -> Result<(), Error> {
        match self.role {
            Role::Player => {
                self.players
                    .verify_client_cert(certificate, intermediates, now)?;
            }
            // The server's name is not verified: certificates state roles, not hosts.
            Role::Node => rustls::client::verify_server_cert_signed_by_trust_anchor(
                &rustls::server::ParsedCertificate::try_from(certificate)?,
                &self.roots,
                intermediates,
                now,
                self.provider.signature_verification_algorithms.all,
            )?,
        }
        // The chain proves the farm; the role is a URI in the subject alternative names.
        if !grants(certificate, self.role) {
            return Err(CertificateError::ApplicationVerificationFailure.into());
        }
        match self.denied.denies(certificate) {
            true => Err(CertificateError::Revoked.into()),
            false => Ok(()),
        }
    }

    fn signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        rustls::crypto::verify_tls13_signature(
            message,
            certificate,
            signed,
            &self.provider.signature_verification_algorithms,
        )
    }

    fn schemes(&self) -> Vec<SignatureScheme> {
        self.provider
            .signature_verification_algorithms
            .supported_schemes()
    }
}

fn only_tls13() -> Error {
    Error::PeerIncompatible(rustls::PeerIncompatible::Tls12NotOffered)
}

impl ServerCertVerifier for PeerVerifier {
    fn verify_server_cert(
        &self,
        certificate: &CertificateDer<'_>,
        intermediates: &[CertificateDer<'_>],
        _name: &ServerName<'_>,
        _ocsp: &[u8],
        now: UnixTime,
    ) -> Result<ServerCertVerified, Error> {
        self.verify(certificate, intermediates, now)?;
        Ok(ServerCertVerified::assertion())
    }

    fn verify_tls12_signature(
        &self,
        _message: &[u8],
        _certificate: &CertificateDer<'_>,
        _signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        Err(only_tls13())
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        self.signature(message, certificate, signed)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.schemes()
    }
}

impl ClientCertVerifier for PeerVerifier {
    fn client_auth_mandatory(&self) -> bool {
        self.mandatory
    }

    fn root_hint_subjects(&self) -> &[DistinguishedName] {
        // A client has one certificate: hints would only reveal the farm's name to strangers.
        &[]
    }

    fn verify_client_cert(
        &self,
        certificate: &CertificateDer<'_>,
        intermediates: &[CertificateDer<'_>],
        now: UnixTime,
    ) -> Result<ClientCertVerified, Error> {
        self.verify(certificate, intermediates, now)?;
        Ok(ClientCertVerified::assertion())
    }

    fn verify_tls12_signature(
        &self,
        _message: &[u8],
        _certificate: &CertificateDer<'_>,
        _signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        Err(only_tls13())
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        self.signature(message, certificate, signed)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.schemes()
    }
}
