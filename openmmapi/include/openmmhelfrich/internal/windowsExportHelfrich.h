#ifndef OPENMM_HELFRICH_WINDOWSEXPORT_H_
#define OPENMM_HELFRICH_WINDOWSEXPORT_H_

/* Marks what the library exports: needed on Windows, where nothing is exported by default. */

#ifdef _MSC_VER
#pragma warning(disable : 4251)
#if defined(HELFRICH_BUILDING_SHARED_LIBRARY)
#define OPENMM_EXPORT_HELFRICH __declspec(dllexport)
#else
#define OPENMM_EXPORT_HELFRICH __declspec(dllimport)
#endif
#else
#define OPENMM_EXPORT_HELFRICH
#endif

#endif /*OPENMM_HELFRICH_WINDOWSEXPORT_H_*/
